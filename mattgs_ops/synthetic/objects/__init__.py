"""The objects of the rendered captures, one module each, and the ``parts`` they are made of.

Each module has ``build(stage, rng, ground)`` and the constants ``LAYOUT``, ``ORBITS``, ``TARGET``,
``WINDOW`` and ``LIGHT``.
"""
