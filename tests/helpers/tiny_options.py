"""Options of the smallest training that has every part, for tests and for programs beside them."""

SMALL = "model.encoder=lcnet_035"
"""An encoder whose checkpoints take a megabyte, for the networks that take any."""
SMALLEST = (
    "preset=smoke",
    "data/split=custom",
    "data.split.train=[cecum_t1_a,trans_t1_a:0-1]",
    "data.split.val=[trans_t1_a:1-2]",
    "data.split.test=[desc_t4_a,trans_t1_a:2-2]",
    "data.size=[64,80]",
    "data.batch_size=2",
    "phantom.size=[64,80]",
    "phantom.frames_per_video=3",
    "callbacks.panels=1",
)
TINY = (*SMALLEST, "trainer.max_epochs=1")
