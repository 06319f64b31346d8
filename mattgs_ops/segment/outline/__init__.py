"""The learned outline: a small network that moves a mask's outline to the object's in the photo.

``coarse`` spoils exact masks as votes and saliency do, ``crops`` cuts training pairs along
outlines of what ``images`` draws, ``network`` is the network, ``train`` trains it by a
``train_config``, ``refine`` asks the bundled file.
"""
