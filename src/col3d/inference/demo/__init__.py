"""Demo in the browser for one network: shows depth and normals of an image or a short video."""
