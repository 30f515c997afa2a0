"""Depth of an image by a file of export.py, and no torch: python onnx_depth.py model.onnx in.png out.png."""

import json
import sys

import cv2
import numpy as np
import onnxruntime

model, source, target = sys.argv[1:]
session = onnxruntime.InferenceSession(model)
facts = session.get_modelmeta().custom_metadata_map
image = cv2.cvtColor(cv2.imread(source), cv2.COLOR_BGR2RGB)
height, width = json.loads(facts["trained_size"])  # any size runs; this one was trained
seen = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32) / 255
(depth,) = session.run(["depth"], {"image": seen.transpose(2, 0, 1)[None]})
depth = cv2.resize(depth[0, 0], (image.shape[1], image.shape[0]))
print(f"{depth.min():.1f} to {depth.max():.1f} mm, if the lens is that of training")
cv2.imwrite(target, np.rint(depth / float(facts["max_depth"]) * 65535).astype(np.uint16))  # as C3VD's depth
