"""Shapes and surfaces: ``mesh``, ``materials``, procedural ``textures`` and printed matter.

``atlas`` packs many small meshes and images into few large ones, which is what makes rendering
fast.
"""
