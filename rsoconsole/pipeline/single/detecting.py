"""The streaks of single frames, as one configuration finds them."""

from rsoconsole.config import Config
from rsoconsole.pipeline.frame import Calibration, cautions
from rsoconsole.records import Detections, Frame
from rsoconsole.vision.detector import ConfidenceCurve, Network, StreakDetector


class FrameDetector:
    """Calibrates a frame and looks for streaks in it; each frame by itself."""

    def __init__(self, config: Config) -> None:
        """Raises ModelError when the network cannot be loaded."""
        settings = config.detector
        network = Network.load(settings.model, settings.threads)
        self._config = config
        self._detector = StreakDetector(network, settings, ConfidenceCurve.from_card(network.card))
        self._calibration = Calibration(config)

    def detect(self, frame: Frame) -> tuple[Detections, tuple[str, ...]]:
        """What was found, and what is to be known of the frame, a sentence each."""
        prepared, noted = self._calibration.prepare(frame)
        found = self._detector.analyse(prepared).detections
        notes = (*noted, *cautions(frame, None, self._config))
        return found, tuple(each.words for each in notes)
