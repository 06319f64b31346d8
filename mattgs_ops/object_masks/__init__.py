"""Cross-view masks: what all views agree on corrects each photo's mask. Comes after ``splat``.

``silhouettes`` predicts each view's map from the others' outlines; ``own_maps`` chooses between
several networks' maps; ``splats`` lets views vote through splats; ``map_scores`` compares outlines
with photos' maps and edges, and ``decision`` weighs votes, silhouettes and maps by these scores;
``vote_checks`` says why votes are not used, for the capture or a single view; ``corrected_maps``
averages maps; ``vote_variants`` lets views vote in several ways; ``photo_evidence`` measures edges,
colours and a plain ground in single photos; ``agreed_masks`` writes the result, ``contradictions``
compares it with itself and ``doubts`` says what is wrong with it; ``cross_view`` runs it all.
Public face: ``cross_view.agree``.
"""
