//! Charts of the sensor maps.

use super::charts::{Figure, VIEW};
use super::gather::RunData;
use crate::map;
use georeference::SensorMap;
use plot::{Axis, BLACK, Chart, Series, SeriesStyle};

/// Creates a figure for each map.
pub fn figures(run: &RunData) -> Vec<Figure> {
    run.maps.iter().filter_map(|(name, map)| figure(name, map)).collect()
}

fn figure(name: &str, map: &SensorMap) -> Option<Figure> {
    let spec = *map.grid().spec();
    let known: Vec<([f64; 2], (f64, f64))> =
        spec.places().filter_map(|(column, row)| Some((spec.centre(column, row), map.value(column, row)?))).collect();
    let low = known.iter().map(|(_, (value, _))| *value).fold(f64::INFINITY, f64::min);
    let high = known.iter().map(|(_, (value, _))| *value).fold(f64::NEG_INFINITY, f64::max);
    let mut sigmas: Vec<f64> = known.iter().map(|(_, (_, sigma))| *sigma).collect();
    sigmas.sort_by(f64::total_cmp);
    let median = *sigmas.get(sigmas.len() / 2)?;
    let share = |value: f64| if high > low { (value - low) / (high - low) } else { 0.5 };
    let colours = known.iter().map(|(_, (value, _))| share(*value)).collect();
    let points = known.iter().map(|(centre, _)| *centre).collect();
    let mut series = vec![Series::line("", 0, points).with_style(SeriesStyle::Cells([spec.cell_m; 2], colours))];
    let at = |[column, row]: [f64; 2]| {
        [spec.origin_m[0] + (column + 0.5) * spec.cell_m, spec.origin_m[1] + (row + 0.5) * spec.cell_m]
    };
    let mut lines = Vec::new();
    // No contour lines through noise.
    for level in if high - low > 4.0 * median { map::levels([low, high]) } else { Vec::new() } {
        let value = |column: usize, row: usize| map.value(column, row).map(|(value, _)| value);
        for [a, b] in map::contours(&value, spec.columns, spec.rows, level) {
            lines.extend([at(a), at(b), [f64::NAN; 2]]);
        }
    }
    series.push(Series::line("", BLACK, lines).with_style(SeriesStyle::Line(1)));
    let [quantity, unit] = map.names();
    let what = if quantity.is_empty() { "value" } else { quantity };
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let caption = format!(
        "Map of {name}: {what} from {low:.4} (dark) to {high:.4}{unit} (light); median standard deviation {median:.2e}{unit}"
    );
    let caption = match map.mixed_m() {
        Some([low, high]) => {
            let axis = map.plane().across_axis();
            format!("{caption}; samples from {axis} = {low:.2} to {high:.2} m in one map, which its deviations contain")
        }
        None => caption,
    };
    let [x, y] = map.plane().axes().map(|axis| Axis::auto(&format!("{axis}, m")));
    Some(Figure::new(&caption, VIEW, Chart { x, y, series, equal_scale: true, ..Chart::default() }))
}
