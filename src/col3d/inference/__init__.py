"""A trained network at work: the predictor, prediction of images, export, fusion, the demo.

Nothing here is scored or trained.
"""
