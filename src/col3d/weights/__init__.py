"""The network that comes with col3d: what `checkpoint=shipped` means.

`shipped.ckpt` has seen rendered colons alone, no frame of a patient and none of C3VD. `docs/sim2real.md` has
the command and seed that made it, its errors on real frames, and what it is good for and what not.
"""

SHIPPED_SHA256 = "a4328a05bde52c7e9c7a3ba26c726c48407e210ec843255eb8e723e52f289250"
"""Of `shipped.ckpt`; `sha256sum` gives it."""
