"""Work of the pipeline: images and observations that wait for their poses, and how they are answered."""

from aerodft.service.work.answering import Answering, Estimators
from aerodft.service.work.observed_requests import fixed_requests, locate_observation
from aerodft.service.work.pending import PendingWork
from aerodft.service.work.work_list import ReadyWork, Task, WorkList

__all__ = [
    "Answering",
    "Estimators",
    "PendingWork",
    "ReadyWork",
    "Task",
    "WorkList",
    "fixed_requests",
    "locate_observation",
]
