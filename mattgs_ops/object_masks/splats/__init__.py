"""What views agree on through splats: surfaces that all photos share, and a vote of views on each.

``surfaces`` trains them; ``votes`` lets views vote on each splat and renders the result with
``labels``; ``ground_plane`` finds the plane that the object stands on, and ``attached_parts`` joins
what touches the object in 3D. Public face: ``surfaces.train_surfaces``, ``votes.collect`` and
``votes.masks_of``.
"""
