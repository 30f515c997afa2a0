"""Monocular depth and surface normals in colonoscopy: networks, geometry, data, metrics and reports."""
