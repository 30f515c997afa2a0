"""Export of networks to files for other programs: ONNX, `torch.export`, weights in half precision."""
