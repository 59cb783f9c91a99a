//! Conversion of motion segments between messages ([`PlanSegment`]) and the form that controllers evaluate
//! ([`Segment`]).

#![forbid(unsafe_code)]

use cable_robot::path::{Bow, Lateral, Line, Parabola, Spiral};
use cable_robot::profile::{Knot, MAX_KNOTS};
use cable_robot::{MAX_CABLES, Motion, Path, Profile, Segment, Vector3};
use messages::{CABLES, KNOTS, PlanMotion, PlanSegment};

const _: () = assert!(KNOTS == MAX_KNOTS && CABLES == MAX_CABLES);

/// Returns the message of a segment.
#[must_use]
pub fn segment_message(segment: &Segment) -> PlanSegment {
    let (kind, shape) = match segment.path {
        Path::Dwell(_) => (PlanSegment::KIND_DWELL, [0.0; 8]),
        Path::Line(_) => (PlanSegment::KIND_LINE, [0.0; 8]),
        Path::Parabola(p) => (PlanSegment::KIND_PARABOLA, [p.mu_per_m, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        Path::Spiral(s) => {
            let angle = 2.0 * std::f64::consts::PI * s.turns;
            let growth = (s.end_radius_m - s.start_radius_m) / angle.abs();
            let shape = [s.centre.x, s.centre.y, s.start_radius_m, growth, s.start_angle_rad, angle, s.rise_m, 0.0];
            (PlanSegment::KIND_SPIRAL, shape)
        }
        Path::Lateral(l) => {
            let ([d1, d2, d3], [s1, s2, s3]) = (l.bow().down_m, l.bow().side_m);
            (PlanSegment::KIND_LATERAL, [d1, d2, d3, s1, s2, s3, 0.0, 0.0])
        }
    };
    let mut message = PlanSegment {
        start_s: segment.start_s,
        duration_s: segment.profile.duration(),
        length_m: segment.path.length(),
        from_m: segment.path.start().into(),
        to_m: segment.path.end().into(),
        shape,
        id: segment.id as u32,
        knot_count: segment.profile.knots().len() as u32,
        kind,
        ..PlanSegment::default()
    };
    for (i, knot) in segment.profile.knots().iter().enumerate() {
        message.knot_s_m[i] = knot.s_m;
        message.knot_v_m_s[i] = knot.v_m_s;
    }
    message
}

/// Returns the segment of a message; `None` if it carries none or an invalid one, because another process may have
/// written any bytes.
#[must_use]
pub fn segment_of(message: &PlanSegment) -> Option<Segment> {
    if !message.from_m.iter().chain(&message.to_m).all(|value| value.is_finite()) {
        return None; // also where the kind of path does not use all of them
    }
    let (from, to) = (Vector3::from(message.from_m), Vector3::from(message.to_m));
    let path = match message.kind {
        PlanSegment::KIND_DWELL => Path::Dwell(from),
        PlanSegment::KIND_LINE => Path::Line(Line { from, to }),
        PlanSegment::KIND_PARABOLA => Path::Parabola(Parabola { from, to, mu_per_m: message.shape[0] }),
        PlanSegment::KIND_SPIRAL => {
            let [x, y, start_radius_m, growth, start_angle_rad, angle, rise_m, _] = message.shape;
            Path::Spiral(Spiral {
                centre: Vector3::new(x, y, from.z),
                start_radius_m,
                // A spiral that closes in ends a rounding error beside its axis.
                end_radius_m: (start_radius_m + growth * angle.abs()).max(0.0),
                turns: angle / (2.0 * std::f64::consts::PI),
                rise_m,
                start_angle_rad,
            })
        }
        PlanSegment::KIND_LATERAL => {
            let [d1, d2, d3, s1, s2, s3, ..] = message.shape;
            Path::Lateral(Lateral::new(Bow { from, to, down_m: [d1, d2, d3], side_m: [s1, s2, s3] }))
        }
        _ => return None,
    };
    path.check().ok()?;
    let count = message.knot_count as usize;
    let profile = if message.kind == PlanSegment::KIND_DWELL {
        Profile::dwell(message.duration_s).ok()?
    } else {
        let mut knots = [Knot::default(); MAX_KNOTS];
        for (i, knot) in knots.iter_mut().enumerate() {
            *knot = Knot { s_m: message.knot_s_m[i], v_m_s: message.knot_v_m_s[i] };
        }
        Profile::from_knots(knots.get(..count)?).ok()?
    };
    message.start_s.is_finite().then_some(Segment {
        id: u64::from(message.id),
        path,
        profile,
        start_s: message.start_s,
    })
}

/// The motion of a message; `None` if it carries no motion or no usable current segment. A next segment that makes no
/// sense counts as none: the motion then ends at rest where the current one ends.
#[must_use]
pub fn motion_of(message: &PlanMotion) -> Option<Motion> {
    if message.motion == 0 {
        return None;
    }
    Some(Motion { current: segment_of(&message.current)?, next: segment_of(&message.next) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use cable_robot::profile::ProfileLimits;

    fn segments() -> Vec<Segment> {
        let from = Vector3::new(4.8, 3.0, 0.3);
        let to = Vector3::new(5.5, 2.0, 0.9);
        let spiral = Spiral {
            centre: from,
            start_radius_m: 0.0,
            end_radius_m: 0.6,
            turns: -3.5,
            rise_m: 1.125,
            start_angle_rad: 0.4,
        };
        let paths = [
            Path::line(from, to),
            Path::Parabola(Parabola { from, to, mu_per_m: 0.2 }),
            Path::Spiral(spiral),
            Path::Lateral(Lateral::new(Bow { from, to, down_m: [0.2, 0.01, 0.02], side_m: [-0.3, 0.05, 0.0] })),
            Path::Spiral(Spiral { start_radius_m: 0.6, end_radius_m: 0.0, ..spiral }),
        ];
        let limits = ProfileLimits::rest_to_rest(0.2, 0.3);
        let mut segments: Vec<Segment> = paths
            .iter()
            .enumerate()
            .map(|(i, path)| Segment {
                id: i as u64 + 1,
                path: *path,
                profile: Profile::plan(path, &limits).unwrap(),
                start_s: 1.5,
            })
            .collect();
        segments.push(Segment { id: 9, path: Path::Dwell(from), profile: Profile::dwell(2.0).unwrap(), start_s: 1.5 });
        segments
    }

    #[test]
    fn a_segment_survives_its_message() {
        for segment in segments() {
            let back = segment_of(&segment_message(&segment)).unwrap();
            assert_eq!(back.id, segment.id);
            assert_eq!(back.profile, segment.profile);
            for i in 0..=50 {
                let s = segment.path.length() * f64::from(i) / 50.0;
                assert!((back.path.point(s) - segment.path.point(s)).norm() < 1e-12);
            }
        }
    }

    #[test]
    fn nonsense_is_no_segment() {
        for segment in segments() {
            let good = segment_message(&segment);
            let spoilt = [
                PlanSegment { kind: 77, ..good },
                PlanSegment { start_s: f64::NAN, ..good },
                PlanSegment { from_m: [f64::INFINITY, 0.0, 0.0], ..good },
                PlanSegment { knot_count: 33, duration_s: -1.0, ..good },
                PlanSegment { knot_v_m_s: [f64::NAN; KNOTS], duration_s: f64::NAN, ..good },
            ];
            assert!(spoilt.iter().all(|message| segment_of(message).is_none()));
        }
        assert!(motion_of(&PlanMotion::default()).is_none());
    }
}
