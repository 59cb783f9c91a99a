//! The map of a sensor as a grid that tools draw.

use messages::FieldMap;
use messages::cdr::Cdr;

/// Unknown cell.
const UNKNOWN: i8 = -1;

/// Returns `nav_msgs/OccupancyGrid`: 0 for the smallest and 100 for the largest known value of the map, on the plane
/// z = 0. The grid has the largest size of a map, so every body has the same length; cells beyond the map are unknown.
pub(crate) fn grid(unix_ns: u64, frame: &str, map: &FieldMap) -> Cdr {
    let (columns, rows) = ((map.columns as usize).min(FieldMap::SIDE), (map.rows as usize).min(FieldMap::SIDE));
    // As in the map: row by row.
    let values = map.value.get(..columns * rows).unwrap_or(&[]);
    let known = || values.iter().copied().filter(|value| value.is_finite());
    let (least, most) = (known().fold(f32::INFINITY, f32::min), known().fold(f32::NEG_INFINITY, f32::max));
    let mut cells = [UNKNOWN as u8; FieldMap::CELLS];
    for (at, value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
        // Divided before the difference, which could be infinite.
        let share = (value / 2.0 - least / 2.0) / (most / 2.0 - least / 2.0);
        let cell = if share.is_finite() { (100.0 * share).round() as u8 } else { 50 };
        cells[at / columns * FieldMap::SIDE + at % columns] = cell;
    }
    let mut cdr = Cdr::default();
    cdr.header(unix_ns, frame);
    cdr.time(unix_ns);
    cdr.f32s(&[map.cell_m as f32]);
    cdr.u32(FieldMap::SIDE as u32);
    cdr.u32(FieldMap::SIDE as u32);
    cdr.pose(&[map.origin_m[0], map.origin_m[1], 0.0]);
    cdr.bytes(&cells);
    cdr
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::ros::OccupancyGrid;

    fn cells(values: &[f32], columns: u32) -> Vec<i8> {
        let mut map =
            FieldMap { columns, rows: values.len() as u32 / columns.max(1), cell_m: 0.5, ..FieldMap::default() };
        map.value = [f32::NAN; FieldMap::CELLS];
        map.value[..values.len()].copy_from_slice(values);
        let body = grid(7, "map", &map).0;
        assert!(OccupancyGrid::from_body(&body).is_some(), "{} bytes", body.len());
        bytemuck::cast_slice(&body[body.len() - FieldMap::CELLS..]).to_vec()
    }

    #[test]
    fn values_are_between_the_smallest_and_the_largest_one() {
        let found = cells(&[-1.0, f32::NAN, 3.0, 0.0, 1.0, 2.0], 3);
        assert_eq!(found[..4], [0, UNKNOWN, 100, UNKNOWN]);
        assert_eq!(found[FieldMap::SIDE..FieldMap::SIDE + 4], [25, 50, 75, UNKNOWN]);
        assert!(found[FieldMap::SIDE + 4..].iter().all(|cell| *cell == UNKNOWN));
    }

    #[test]
    fn maps_without_a_range_are_drawn_too() {
        assert_eq!(cells(&[4.0, 4.0], 2)[..3], [50, 50, UNKNOWN]);
        assert!(cells(&[], 0).iter().all(|cell| *cell == UNKNOWN));
        assert!(cells(&[f32::NAN], 1).iter().all(|cell| *cell == UNKNOWN));
        assert_eq!(cells(&[f32::MIN, f32::MAX, f32::INFINITY, 0.0], 4)[..4], [0, 100, UNKNOWN, 50]);
    }
}
