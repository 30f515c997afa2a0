"""The network that comes with col3d: what `checkpoint=shipped` means.

`shipped.ckpt` has seen rendered colons alone, no frame of a patient and none of C3VD. `docs/sim2real.md` has
the command and seed that made it, its errors on real frames, and what it is good for and what not.
"""

SHIPPED_SHA256 = "6900f68809e52241f4829155a54d2499f512cd34051da614fb956d97f771ccf7"
"""Of `shipped.ckpt`; `sha256sum` gives it."""
