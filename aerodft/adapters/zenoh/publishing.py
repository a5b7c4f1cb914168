"""Publishers that drop rather than wait, one a key, declared at first use."""

import zenoh


class Publishers:
    """The publishers of one session; used by several threads, each with keys of its own."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._declared: dict[str, zenoh.Publisher] = {}

    def json(self, key: str, payload: bytes) -> None:
        """Publish a JSON payload."""
        self._publisher(key, zenoh.Encoding.APPLICATION_JSON).put(payload)

    def jpeg(self, key: str, payload: bytes, attachment: bytes) -> None:
        """Publish a JPEG, with the JSON of its image attached."""
        self._publisher(key, zenoh.Encoding.IMAGE_JPEG, zenoh.Priority.DATA_LOW).put(payload, attachment=attachment)

    def close(self) -> None:
        """Withdraw all publishers."""
        for publisher in self._declared.values():
            publisher.undeclare()  # type: ignore[no-untyped-call]  # zenoh is annotated in part
        self._declared.clear()

    def _publisher(
        self, key: str, encoding: zenoh.Encoding, priority: zenoh.Priority = zenoh.Priority.DATA
    ) -> zenoh.Publisher:
        publisher = self._declared.get(key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                key, encoding=encoding, congestion_control=zenoh.CongestionControl.DROP, priority=priority
            )
            self._declared[key] = publisher
        return publisher
