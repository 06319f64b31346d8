"""Structure-from-motion on photos and masks, in a process of its own.

``reconstruct`` is the public face. It checks the input (``checks``), hands a job to COLMAP's
process (``colmap/``), and turns COLMAP's model into a scene folder (``assemble``); ``alignment``
measures pose errors, ``figure`` shows it.
"""

from mattgs_ops.sfm.pipeline import reconstruct

__all__ = ["reconstruct"]
