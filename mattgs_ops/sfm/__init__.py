"""Structure-from-motion on photos and masks, in a process of its own.

``reconstruct`` is the one way in. It checks the input (``checks``), hands a job to a worker process
(``process``, ``job``, ``worker``), which extracts (``features``), matches (``matching``) and maps
(``mapping``) in one or two ``attempts``, and turns COLMAP's model into a scene folder
(``assemble``, ``hull``). Only the worker loads COLMAP.
"""

from mattgs_ops.sfm.pipeline import reconstruct

__all__ = ["reconstruct"]
