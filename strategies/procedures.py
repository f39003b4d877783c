"""The exploratory procedures a strategy may order, one line each."""

PROCEDURES: dict[str, str] = {
    "containment": "tendon-guarded closing of all fingers at each waypoint (paper, section IV-C)",
    "planar": "faces crossed with the extended index finger's pad (paper, section IV-D)",
    "contour": "sections between thumb and index finger along an axis (paper, section IV-E)",
}
