"""The camera's attitude at stamps, from gimbal reports and the vehicle's attitude."""

from aerodft.service.attitude.gimbal_frame import FrameEvidence
from aerodft.service.attitude.history import AttitudeHistory, AttitudeSeries, attitude_histories
from aerodft.service.attitude.mounts import GIMBAL_MOUNTS, Mount
from aerodft.service.attitude.readings import AttitudeBatch, reference_wxyz
from aerodft.service.attitude.sources import AttitudeSources
