//! Missions and requests to checked motion segments.
