//! A picture of the robot itself in a run: poles, pulleys, cables, the node, and the path that it flew.

use crate::accuracy::{Analysis, TrackPoint};
use crate::colours::ESTIMATE;
use cable_robot::{Robot, Vector3};
use command::{Answer, Failure};
use plot::{COLOURS, css_colour, escape};
use std::fmt::Write as _;
use std::path::Path;

/// Width and height of the picture, px.
const SIZE: [f64; 2] = [960.0, 520.0];
/// Margin around the robot, px.
const MARGIN: f64 = 46.0;
/// Direction from which the robot is seen: turned about the vertical, and from above; degrees.
const VIEW_DEG: [f64; 2] = [-28.0, 24.0];
/// Points of the drawn path; more are not seen.
const POINTS: usize = 400;

/// Writes the picture of a robot that flew these positions.
///
/// # Errors
/// The run has no motion, or the file cannot be written.
pub fn draw(path: &Path, robot: &Robot, analysis: &Analysis) -> Answer {
    let track = &analysis.track;
    // The node is drawn where it flew highest.
    let Some(node) = track.iter().max_by(|a, b| a.estimate.z.total_cmp(&b.estimate.z)) else {
        return Err(Failure::NotNow("the run has no motion to draw".to_owned()));
    };
    let picture = portrait(robot, track, &node.estimate);
    std::fs::write(path, picture)
        .map_err(|error| Failure::NotNow(format!("the picture {} cannot be written: {error}", path.display())))
}

/// Projects points onto the picture.
struct Camera {
    scale: f64,
    middle: [f64; 2],
}

impl Camera {
    /// A camera that shows all of these points.
    fn showing(points: &[Vector3<f64>]) -> Self {
        let seen: Vec<[f64; 2]> = points.iter().map(turned).collect();
        let range = |axis: usize| {
            seen.iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at[axis]), high.max(at[axis])])
        };
        let [x, y] = [range(0), range(1)];
        let fits = |axis: usize, [low, high]: [f64; 2]| (SIZE[axis] - 2.0 * MARGIN) / (high - low).max(1e-6);
        let middle = [x, y].map(|[low, high]| 0.5 * (low + high));
        Self { scale: fits(0, x).min(fits(1, y)), middle }
    }

    fn pixel(&self, point: &Vector3<f64>) -> [f64; 2] {
        let [x, y] = turned(point);
        [0.5 * SIZE[0] + self.scale * (x - self.middle[0]), 0.5 * SIZE[1] - self.scale * (y - self.middle[1])]
    }

    fn points<'a>(&self, points: impl IntoIterator<Item = &'a Vector3<f64>>) -> String {
        let mut text = String::new();
        for point in points {
            let [x, y] = self.pixel(point);
            let _ = write!(text, "{x:.1},{y:.1} ");
        }
        text.trim_end().to_owned()
    }
}

/// Parallel projection from the direction of view: to the right and upwards, m.
fn turned(point: &Vector3<f64>) -> [f64; 2] {
    let [(sin_a, cos_a), (sin_e, cos_e)] = VIEW_DEG.map(|degrees| f64::to_radians(degrees).sin_cos());
    let (right, back) = (cos_a * point.x - sin_a * point.y, sin_a * point.x + cos_a * point.y);
    [right, sin_e * back + cos_e * point.z]
}

/// Renders the picture; `node` is where the node is drawn.
fn portrait(robot: &Robot, track: &[TrackPoint], node: &Vector3<f64>) -> String {
    let ground = |at: &Vector3<f64>| Vector3::new(at.x, at.y, robot.ground_m());
    let anchors: Vec<Vector3<f64>> = robot.anchors().iter().copied().collect();
    let feet: Vec<Vector3<f64>> = anchors.iter().map(ground).collect();
    let step = track.len().div_ceil(POINTS).max(1);
    let flown: Vec<Vector3<f64>> = track.iter().step_by(step).map(|point| point.estimate).collect();
    let shadow: Vec<Vector3<f64>> = flown.iter().map(ground).collect();
    let camera = Camera::showing(&[anchors.clone(), feet.clone(), flown.clone()].concat());
    let [width, height] = SIZE;
    let mut out = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" font-size=\"14\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    let mut line = |points: String, style: &str| {
        let _ = writeln!(out, "<polyline points=\"{points}\" fill=\"none\" stroke-linejoin=\"round\" {style}/>");
    };
    // The ground between the poles, in the order of a walk around them.
    let middle = feet.iter().sum::<Vector3<f64>>() / feet.len() as f64;
    let mut around = feet.clone();
    around.sort_by(|a, b| (a.y - middle.y).atan2(a.x - middle.x).total_cmp(&(b.y - middle.y).atan2(b.x - middle.x)));
    around.extend(around.first().copied());
    line(camera.points(&around), "stroke=\"#c9d2da\" stroke-width=\"1.5\" stroke-dasharray=\"5 5\"");
    line(camera.points(&shadow), "stroke=\"#d9dfe5\" stroke-width=\"3\"");
    for (foot, anchor) in feet.iter().zip(&anchors) {
        line(camera.points([foot, anchor]), "stroke=\"#6b5a48\" stroke-width=\"7\" stroke-linecap=\"round\"");
    }
    line(camera.points(&flown), &format!("stroke=\"{}\" stroke-width=\"2.5\"", css_colour(ESTIMATE)));
    line(camera.points([&ground(node), node]), "stroke=\"#b9c3cd\" stroke-width=\"1\" stroke-dasharray=\"3 4\"");
    for (cable, anchor) in anchors.iter().enumerate() {
        line(camera.points([anchor, node]), &format!("stroke=\"{}\" stroke-width=\"2\"", colour_of(cable)));
    }
    labels(&mut out, &camera, &anchors, node);
    out.push_str("</svg>\n");
    out
}

/// Pulleys, node and their names.
fn labels(out: &mut String, camera: &Camera, anchors: &[Vector3<f64>], node: &Vector3<f64>) {
    for (cable, anchor) in anchors.iter().enumerate() {
        let [x, y] = camera.pixel(anchor);
        let (colour, name) = (colour_of(cable), escape(&format!("pulley {}", cable + 1)));
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7\" fill=\"#ffffff\" stroke=\"{colour}\" stroke-width=\"3\"/>"
        );
        let _ = writeln!(
            out,
            "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#46525f\">{name}</text>",
            y - 14.0
        );
    }
    let [x, y] = camera.pixel(node);
    let _ = writeln!(
        out,
        "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"22\" height=\"16\" rx=\"3\" fill=\"#1d2733\"/>",
        x - 11.0,
        y - 3.0
    );
    let _ = writeln!(out, "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#1d2733\">node</text>", x + 17.0, y + 11.0);
}

fn colour_of(cable: usize) -> String {
    // Black is for the truth elsewhere.
    css_colour(cable % (COLOURS.len() - 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_shows_every_point_and_keeps_up_above_down() {
        let room = [[0.0, 0.0, 0.0], [9.0, 0.0, 3.0], [4.0, 8.0, 3.0], [4.0, 8.0, 0.0]].map(Vector3::from);
        let camera = Camera::showing(&room);
        for point in &room {
            let at = camera.pixel(point);
            assert!((0..2).all(|axis| at[axis] >= MARGIN - 1e-6 && at[axis] <= SIZE[axis] - MARGIN + 1e-6), "{at:?}");
        }
        let [top, foot] = [2, 3].map(|corner: usize| camera.pixel(&room[corner]));
        assert!(top[1] < foot[1] && (top[0] - foot[0]).abs() < 1e-9, "a pole stands upright");
    }
}
