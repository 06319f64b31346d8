"""Cross-view masks: what all views agree on corrects each photo's mask. Comes after ``splat``.

``silhouettes`` predicts each view's map from the others' outlines; ``own_maps`` chooses between
several networks' maps; ``splats`` lets views vote through splats; ``witnesses`` asks photos' maps
and edges about outlines, and ``decision`` weighs votes, silhouettes and maps by what they say;
``corrected_maps`` averages them; ``poll`` lets views vote in several ways;
``photo_evidence`` asks single photos about edges, colours and a plain ground; ``agreed_masks``
writes the result and ``doubts`` says what is wrong with it; ``cross_view`` runs it all. Public
face: ``cross_view.agree``.
"""
