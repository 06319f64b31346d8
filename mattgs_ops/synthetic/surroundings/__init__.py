"""What stands around an object: a ``desk`` with ``clutter``, ``gadgets`` and ``furniture``.

``item`` is the footprint and height of one thing that lies there.
"""
