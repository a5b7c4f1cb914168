"""Work of the pipeline: images and observations that wait for their poses, and how they are answered."""

from aerodft.service.work.answering import Answering, Estimators, ReadyWork, fixed_requests, locate_observation
from aerodft.service.work.pending import AnswerTimes, RecentImages, Task, WorkList, answer_in_order

__all__ = [
    "AnswerTimes",
    "Answering",
    "Estimators",
    "ReadyWork",
    "RecentImages",
    "Task",
    "WorkList",
    "answer_in_order",
    "fixed_requests",
    "locate_observation",
]
