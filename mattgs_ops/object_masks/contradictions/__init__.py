"""Whether the delivered masks contradict each other: at shared points, and through the cameras.

``shared_points`` needs no camera, ``shared_outlines`` needs them: where only the latter finds
photos that contradict the others, their cameras are wrong rather than their masks.
"""
