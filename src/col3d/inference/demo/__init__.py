"""A page in the browser for one network: give it an image or a short video and look at depth and normals."""
