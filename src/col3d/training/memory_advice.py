"""What a training that is out of memory is advised to change."""

from col3d.training.options import TrainOptions


def memory_advice(options: TrainOptions) -> str:
    """Suggest what to change if there is too little memory: the same steps with half as much at a time."""
    size, accumulate = options.data.batch_size, options.trainer.accumulate
    if size > 1:
        halved = f"data.batch_size={size // 2} trainer.accumulate={accumulate * 2}"
        return f"data.batch_size={size} is too much; {halved} takes half of it a step and is trained alike"
    height, width = options.data.size
    return f"data.size=[{height // 2},{width // 2}] takes a quarter; so does a smaller model.encoder"
