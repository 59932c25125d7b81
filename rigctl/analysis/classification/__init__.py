"""PCA and LDA, data splits, trained models and their predictions."""
