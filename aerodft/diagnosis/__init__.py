"""What a log or link holds, what is wrong with it, and what to do about it, in plain sentences."""

from aerodft.diagnosis.camera_pitch import CameraPitches
from aerodft.diagnosis.findings import document, notes, problems
from aerodft.diagnosis.flight_checks import ImageCheck
from aerodft.diagnosis.log_diagnosis import DiagnosisReport, LogDiagnosis, SourceSummary
from aerodft.diagnosis.message_requests import RequestOutcome, request_messages
