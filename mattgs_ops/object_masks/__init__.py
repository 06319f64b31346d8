"""Cross-view masks: what all views agree on corrects each photo's mask. Comes after ``splat``.

``cross_view`` trains splats for a short while and lets views vote; ``attached_parts`` joins what
touches the object in 3D; ``ground_plane`` finds the plane it stands on. Public face:
``cross_view.agree``.
"""
