"""Depth of an image by an ONNX file of ours, and no torch: python onnx_depth.py model.onnx in.png out.png."""

import json
import sys

import numpy as np
import onnxruntime
from PIL import Image

model, source, target = sys.argv[1:]
session = onnxruntime.InferenceSession(model)
facts = session.get_modelmeta().custom_metadata_map
image = Image.open(source, formats=["PNG", "JPEG", "BMP", "TIFF", "WEBP"]).convert("RGB")
height, width = json.loads(facts["trained_size"])  # any size runs; this one was trained
seen = np.asarray(image.resize((width, height), Image.Resampling.BILINEAR), np.float32) / 255
(depth,) = session.run(["depth"], {"image": seen.transpose(2, 0, 1)[None]})
print(f"{depth.min():.1f} to {depth.max():.1f} mm, if the lens is that of training")
depth = np.asarray(Image.fromarray(depth[0, 0]).resize(image.size, Image.Resampling.BILINEAR))
codes = np.rint(depth / float(facts["max_depth"]) * 65535).astype(np.uint16)  # as C3VD stores depth
Image.fromarray(codes).save(target)
