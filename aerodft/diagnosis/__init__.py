"""What a log or link holds, what is wrong with it, and what to do about it, in plain sentences."""

from aerodft.diagnosis.findings import document, notes, problems
from aerodft.diagnosis.message_requests import Outcome, ask
from aerodft.diagnosis.survey import LogDiagnosis, SurveyReport, ValueSource
