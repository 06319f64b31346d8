"""U²-Net: architecture, training, export and inference.

``u2net`` is the network, ``train`` (``train_config``, ``batches``, ``augment``, ``losses``) trains
it, ``export`` writes ONNX, ``saliency`` runs an ONNX file on photos (``preprocess``).
"""
