"""U²-Net segmentation: architecture, training images, training, export, inference."""
