"""What views agree on through splats: surfaces that all photos share, and a vote of views on each.

``surfaces`` trains them; ``votes`` lets views vote on each splat and renders the result with
``labels``; ``location`` says where the object is, ``ground_plane`` finds the plane that it stands
on, and ``attached_parts`` joins what touches it in 3D. Public face: ``surfaces.train_surfaces``,
``votes.collect`` and ``votes.masks_of``.
"""
