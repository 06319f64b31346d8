"""Procedural captures: desks full of things, rendered by a physically based renderer.

Needs the ``captures`` extra (Mitsuba 3). Lengths are centimetres, z is up, the desk's surface is
z = 0 and the object stands at the origin.
"""
