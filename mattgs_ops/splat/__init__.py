"""3D Gaussian Splatting on the CPU: parameters, rasteriser, losses.

``gaussians`` holds the parameters, ``rasterize`` and ``ssim`` call the compiled engine,
``attention`` is the paper's map, ``exposure`` a change of colour per photo, ``photos`` the training
images. ``training/`` optimises,
``files/`` reads and writes splat formats. Public face: ``training.train.train``,
``render.render_view``.
"""
