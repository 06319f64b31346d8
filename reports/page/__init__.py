"""The report as a folder and as one offline page.

``build`` makes the folder, ``page`` the HTML file from ``templates/``, ``splat_view`` the splats in
it; ``compare`` is the page of two runs, ``viser_viewer`` shows splats live. Public
face: ``build.build``.
"""
