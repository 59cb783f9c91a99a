//! What a calibration with small residuals may hide, as one clause for users.

use calibration::{
    Calibration, Effect, Freed, Measurements, Misfit, RadiusCheck, RadiusSlip, Undecided, UnmeasuredRadius, misfit,
    radius_check, undecided,
};

const AXES: [&str; 3] = ["x", "y", "z"];

/// Returns why this result must not be used; None if nothing speaks against it.
pub fn refusal(measured: &Measurements, found: &Calibration, numbers: &[usize]) -> Option<String> {
    if let Some(open) = undecided(measured, found) {
        return Some(undecided_clause(&open));
    }
    if let Some(RadiusCheck::Slip(slip)) = radius_check(measured, found) {
        return Some(slip_clause(&slip));
    }
    let pattern = misfit(measured, found)?;
    let mut text = misfit_clause(&pattern, measured);
    let far = |a: &&calibration::Outlier, b: &&calibration::Outlier| a.residual_m.abs().total_cmp(&b.residual_m.abs());
    if let Some(o) = found.outliers.iter().max_by(far) {
        let point = numbers.get(o.point).unwrap_or(&o.point) + 1;
        text = say!(
            "{text}; first measure point {point} again, whose cable {} is off by {:.3} m",
            o.cable + 1,
            o.residual_m
        );
    }
    Some(text)
}

/// Least movement of an anchor that is worth a question, m.
const NOTEWORTHY_M: f64 = 0.01;

/// Returns what pulleys of another radius could change; None if it does not matter.
pub fn open_question(measured: &Measurements, open: &UnmeasuredRadius) -> Option<String> {
    let UnmeasuredRadius { radius_m, anchor, axis, shift_m, .. } = open;
    let (radius_mm, coordinate, anchor) = (1000.0 * radius_m, AXES[*axis], anchor + 1);
    let moved =
        say!("with a radius of {radius_mm:.0} mm {coordinate} of anchor {anchor} would be {shift_m:.3} m elsewhere");
    let text = if measured.pulley_radius_m.is_empty() {
        say!(
            "the measurements do not say whether the cables run over pulleys: {moved}; add pulley = \"swivel\" with pulley_radius_m and \
             sigma_pulley_radius_m, or pulley = \"eye\" and the heights of the anchors"
        )
    } else if measured.pulley_radius_m.iter().all(|r| *r == 0.0) {
        say!(
            "the measurements do not exclude wheels in place of eyes, and the deviations include them: {moved}; \
             measure the height of each anchor with a tape or a laser"
        )
    } else {
        say!(
            "the radius of the pulleys was stated and not measured, and the deviations include others: {moved}; \
             add sigma_pulley_radius_m, how well you measured it"
        )
    };
    (*shift_m > NOTEWORTHY_M).then_some(text)
}

/// Returns the question whether a radius is the diameter; None if the lengths exclude it, and without a measured
/// radius.
pub fn slip_question(measured: &Measurements, found: &Calibration) -> Option<String> {
    let wheels = measured.pulley_radius_m.iter().copied().fold(0.0, f64::max);
    (radius_check(measured, found)? == RadiusCheck::Open).then(|| {
        say!(
            "the radius was measured once, and the lengths do not tell it from a diameter (are the wheels {:.0} mm across?); \
             pull a cable until its wheel has turned once, and state in pulley_turn_m how far it moved",
            2000.0 * wheels
        )
    })
}

fn slip_clause(slip: &RadiusSlip) -> String {
    let likely = if slip.likely_m < slip.stated_m { say!("half") } else { say!("twice") };
    say!(
        "the lengths suggest pulleys with a radius of {:.0} ± {:.0} mm, which is rather {likely} of the stated {:.0} mm; \
         measure it again from the axle to the middle of the cable: half of what the wheel measures across",
        1000.0 * slip.suggested_m,
        1000.0 * slip.suggested_std_m,
        1000.0 * slip.stated_m
    )
}

fn undecided_clause(open: &Undecided) -> String {
    let (unknown, key, instead) = match open.unknown {
        Freed::PulleyRadius => (say!("the radius of the pulleys"), "sigma_pulley_radius_m", say!("measure the radius")),
        Freed::Scale => (say!("the scale of the lengths"), "sigma_scale", say!("measure five metres of cable")),
        Freed::Zero(cable) => (
            say!("the zero of cable {}", cable + 1),
            "sigma_offset_m",
            say!("measure the heights of the pulleys with a tape"),
        ),
    };
    say!(
        "the points do not determine {unknown} (±{:.4} remains of ±{:.4} in {key}), which leaves {} of anchor {} uncertain by \
         {:.3} m; {instead}, or add points between the middle of the site and the feet of the pulleys",
        open.std,
        open.stated,
        AXES[open.axis],
        open.anchor + 1,
        open.shift_m
    )
}

fn misfit_clause(pattern: &Misfit, measured: &Measurements) -> String {
    let stated = measured.pulley_radius_m.iter().any(|r| *r > 0.0);
    let size = pattern.size.unwrap_or_default();
    let std = pattern.size_std.unwrap_or_default();
    let (what, cure) = match pattern.effect {
        Effect::PulleyRadius if stated => (
            say!("pulleys whose radius differs by {:.0} ± {:.0} mm from the stated one", 1000.0 * size, 1000.0 * std),
            say!("measure the radius to the middle of the cable"),
        ),
        Effect::PulleyRadius => (
            say!("pulleys with a radius of {:.0} ± {:.0} mm", 1000.0 * size, 1000.0 * std),
            say!("measure the radius to the middle of the cable and state it in pulley_radius_m"),
        ),
        Effect::Scale => (
            say!("a scale that is off by {:.2} ± {:.2} %", 100.0 * size, 100.0 * std),
            say!("measure five metres of each cable"),
        ),
        Effect::Zeros => (say!("zeros that are off"), say!("check the reading of each cable at a known length")),
        Effect::CableScales => {
            (say!("cables that measure on different scales"), say!("measure five metres of each cable"))
        }
        Effect::Curvature => {
            (say!("lengths whose error grows with their square"), say!("keep the cables taut and check their sag"))
        }
        Effect::Floor => (say!("points on a floor that is not flat"), say!("measure points on a level plane")),
    };
    let first = if stated || pattern.effect == Effect::PulleyRadius {
        cure
    } else {
        say!("check the radius of the pulleys first, then {cure}")
    };
    say!(
        "the lengths do not fit the model: their residuals have the pattern of {what} ({}), which puts {} of anchor {} {:.3} m \
         elsewhere; {first}",
        chance(pattern.probability),
        AXES[pattern.axis],
        pattern.anchor + 1,
        pattern.shift_m
    )
}

fn chance(probability: f64) -> String {
    if probability < 1e-6 {
        say!("by chance less than once in a million")
    } else {
        say!("by chance once in {:.0}", 1.0 / probability)
    }
}
