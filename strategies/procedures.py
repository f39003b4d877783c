"""The exploratory procedures a strategy may order, one line each."""

PROCEDURES: dict[str, str] = {
    "containment": "tendon-guarded closing of all fingers at each waypoint (paper, section IV-C)",
}
