"""Networks on a GPU: right, fast, and where the time goes."""
