"""Parts of the estimators that work with instrumental variables."""
