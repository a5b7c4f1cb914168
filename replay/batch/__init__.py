"""Many recordings computed anew at once, over Dask."""

from replay.batch.cluster import Job, Outcome, State, jobs_of, run_batch
from replay.batch.dataset import Dataset, InputKey, input_key, recording_hash
