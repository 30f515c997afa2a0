"""Networks as files for other programs: ONNX, `torch.export`, weights in half precision."""
