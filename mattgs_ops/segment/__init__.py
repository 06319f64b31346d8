"""Photos → the object's mask in each photo, one photo at a time.

``infer`` runs a saliency network (``network/``) and cleans its maps, ``grabcut`` refines them,
``mask_report`` says how good they look. ``training_images/`` draws what the network is trained on.
Public face: ``infer.segment``.
"""
