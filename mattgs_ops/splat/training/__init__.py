"""Training of splats: a scene in, a folder with splats, curve and report out.

``train`` is the loop, ``trainer`` one step of it, ``schedule`` says when what happens, ``densify``
adds and removes splats, ``optimise`` is Adam, ``initialise`` the start, ``checkpoint`` the way
back. Public face: ``train.train``.
"""
