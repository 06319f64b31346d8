"""What Mitsuba traces for training.

``places`` renders views of random machines and figures, which ``objects`` makes meshes of;
``backdrops`` reads the views without an object, to paint on.
"""
