"""Features to answers: the PCA+LDA sweep and its figures."""
