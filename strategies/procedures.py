"""The exploratory procedures a strategy may order, one line each."""

PROCEDURES: dict[str, str] = {
    "containment": "tendon-guarded closing of all fingers at each waypoint (paper, section IV-C)",
    "planar": "the extended index finger crosses the faces of the body believed (section IV-D)",
    "contour": "thumb and index finger follow the body's contour along its axis (section IV-E)",
    "decide": "the recovered shape picks: faces of a blocky body, contour of a round one, and "
              "its end where that is flat (section V)",
}
