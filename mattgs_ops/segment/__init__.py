"""Photos → the object's mask in each photo, one photo at a time.

``infer`` runs a saliency network (``network/``) and cleans its maps, ``grabcut`` refines them,
``mask_report`` says how good they look. ``outline/`` moves the outlines of masks that views agreed
on. ``training_images/`` draws what both networks are trained on; ``onnx_files/`` and
``training_state`` are their files.
Public face: ``infer.segment``, ``outline.refine.OutlineRefiner``.
"""
