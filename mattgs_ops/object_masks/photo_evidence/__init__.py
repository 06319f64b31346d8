"""What single photos show of masks, without other views.

``edges`` compares outlines with the photo's edges and moves them there, ``colours`` cuts masks anew
by colour, ``plain_ground`` corrects maps where the ground is smooth, ``significance`` tells what
several photos surely show.
Public face: ``correct_by_ground``, ``cut_by_colours``, ``share_on_edges``, ``to_photo_edges``.
"""
