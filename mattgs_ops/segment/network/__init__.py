"""U²-Net: architecture, training, export and inference.

``u2net`` is the network, ``train`` trains it (``train_config``, ``batches``, ``ahead``, ``losses``,
``augment``), ``export`` writes ONNX, ``saliency`` runs an ONNX file on photos (``preprocess``).
"""
