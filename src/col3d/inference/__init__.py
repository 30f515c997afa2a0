"""Use of a trained network: the predictor, prediction of images, export, fusion, the demo.

Nothing here is scored or trained.
"""
