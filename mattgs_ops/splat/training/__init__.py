"""Training of splats: a scene in, a folder with splats, curve and report out.

``train`` sets a training up and writes its result, ``loop`` is the loop over the steps with its
callbacks (curve, checkpoints, speed), ``trainer`` one step; ``schedule`` says when what happens,
``densify`` adds and removes splats, ``optimise`` is Adam, ``initialise`` the start, ``checkpoint``
the way back. Public face: ``train.train``, and ``train.train_in_memory`` for splats without files.
"""
