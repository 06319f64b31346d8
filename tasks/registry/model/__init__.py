"""The MLflow model that a promoted run becomes: its files, its code, its signature.

``saved`` writes the model's folder; ``carried_loader`` travels with it and loads it where this
project is not installed.
"""
