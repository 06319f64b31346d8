"""Cross-view masks: what all views agree on corrects each photo's mask. Comes after ``splat``.

``silhouettes`` predicts each view's map from the others' outlines; ``splat_votes`` lets views vote
through splats; ``attached_parts`` joins what touches the object in 3D, ``ground_plane`` finds the
plane it stands on; ``decision`` weighs votes, silhouettes and maps; ``photo_evidence`` asks single
photos: about edges, colours, and a plain ground; ``doubts`` says what is
wrong with the result; ``cross_view`` runs it all.
Public face: ``cross_view.agree``.
"""
