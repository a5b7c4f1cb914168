"""Who learns from landmarks and follows objects, by counting alone."""

from dataclasses import replace

from aerodft.model import CalibrationEstimate


class Counting:
    """Learns nothing but how often it was asked; what it refines says so."""

    def __init__(self):
        self.asked = []

    def known(self):
        return str(len(self.asked))

    def refine(self, poses, known, which):
        own = [known[k] for k in which.tolist()]
        return poses.with_variants(own, lambda variant, name: replace(variant, calibration=name))

    def observes(self, name):
        return name.startswith("mark")

    def fits(self, observation):
        return len(observation.pixels) == 1

    def observe(self, sample, observations):
        assert sample.calibration is None
        assert {each.stamp_ns for each in observations} == {sample.stamp_ns}
        self.asked.append((sample.stamp_ns, tuple(each.name for each in observations)))
        return CalibrationEstimate(stamp_ns=sample.stamp_ns, calibration=str(len(self.asked)))


class Following:
    """Follows whatever it is shown, and tells nothing of it."""

    def follow(self, setup, sample, observations, image):  # noqa: ARG002 - as an ``ObjectTracker``
        assert {each.stamp_ns for each in observations} == {sample.stamp_ns}
