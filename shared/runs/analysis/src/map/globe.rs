//! Geographic coordinates: the robot's x and y on the tangent plane of the ellipsoid at its origin.
//!
//! With φ the latitude of the origin, M and N the radii of curvature of the ellipsoid along and across the meridian, a
//! point n metres north and e metres east is at φ + n / M and λ + e / (N cos φ). The error grows with the square of the
//! distance: at 100 m it is below a millimetre up to 60 degrees north or south.

use config::SiteSection;
use georeference::{Plane, SensorMap};
use serde_json::{Value, json};

/// Semi-major axis of WGS 84, m.
const A_M: f64 = 6_378_137.0;
/// Eccentricity of WGS 84, squared.
const E2: f64 = 6.694_379_990_141_316e-3;

/// Location and orientation of the robot on the ellipsoid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Globe {
    origin_deg: [f64; 2],
    /// Degrees per metre: of latitude to the north, of longitude to the east.
    deg_per_m: [f64; 2],
    /// Sine and cosine of the direction of the x axis, clockwise from north.
    turn: (f64, f64),
}

impl Globe {
    /// Creates it from `[site]` of the robot file.
    pub(super) fn new(site: &SiteSection) -> Self {
        let latitude = site.latitude_deg.to_radians();
        let flat = 1.0 - E2 * latitude.sin().powi(2);
        let (along_m, across_m) = (A_M * (1.0 - E2) / flat.powf(1.5), A_M / flat.sqrt());
        Self {
            origin_deg: [site.latitude_deg, site.longitude_deg],
            deg_per_m: [along_m.recip().to_degrees(), (across_m * latitude.cos()).recip().to_degrees()],
            turn: site.azimuth_deg.to_radians().sin_cos(),
        }
    }

    /// Returns latitude and longitude of x and y, degrees.
    pub(super) fn at(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sine, cosine) = self.turn;
        // y is to the left of x.
        let (north_m, east_m) = (cosine * x + sine * y, sine * x - cosine * y);
        [self.origin_deg[0] + north_m * self.deg_per_m[0], self.origin_deg[1] + east_m * self.deg_per_m[1]]
    }
}

/// Returns the known cells of a horizontal map as GeoJSON (RFC 7946): one square each, with value and standard
/// deviation; `None` for a vertical map.
pub(super) fn cells(map: &SensorMap, globe: &Globe) -> Option<Value> {
    if map.plane() != Plane::Level {
        return None;
    }
    let spec = map.grid().spec();
    let half_m = 0.5 * spec.cell_m;
    let [quantity, unit] = map.names();
    let mut features = Vec::new();
    for (column, row) in spec.places() {
        let Some((value, sigma)) = map.value(column, row) else { continue };
        let [x, y] = spec.centre(column, row);
        // The format requires anticlockwise, closed rings with the longitude first.
        let ring = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]].map(|[a, b]: [f64; 2]| {
            let [latitude, longitude] = globe.at([x + a * half_m, y + b * half_m]);
            [longitude, latitude]
        });
        features.push(json!({
            "type": "Feature",
            "geometry": { "type": "Polygon", "coordinates": [ring] },
            "properties": { "value": value, "sigma": sigma, "quantity": quantity, "unit": unit },
        }));
    }
    Some(json!({ "type": "FeatureCollection", "features": features }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Earth-centred coordinates of a point on the ellipsoid, m.
    fn in_space([latitude_deg, longitude_deg]: [f64; 2]) -> [f64; 3] {
        let (latitude, longitude) = (latitude_deg.to_radians(), longitude_deg.to_radians());
        let across_m = A_M / (1.0 - E2 * latitude.sin().powi(2)).sqrt();
        [
            across_m * latitude.cos() * longitude.cos(),
            across_m * latitude.cos() * longitude.sin(),
            across_m * (1.0 - E2) * latitude.sin(),
        ]
    }

    #[test]
    fn distances_and_directions_match_space() {
        for latitude_deg in [-55.0, 0.0, 34.07, 60.0] {
            for azimuth_deg in [0.0, 90.0, 210.0] {
                let site = SiteSection { latitude_deg, longitude_deg: -118.4, azimuth_deg };
                let globe = Globe::new(&site);
                let origin = in_space([latitude_deg, -118.4]);
                let away = |at: [f64; 2]| {
                    let place = in_space(globe.at(at));
                    [0, 1, 2].map(|i| place[i] - origin[i])
                };
                for at in [[100.0, 0.0], [0.0, 100.0], [-60.0, 40.0]] {
                    let apart = away(at).iter().map(|d| d * d).sum::<f64>().sqrt();
                    assert!((apart - at[0].hypot(at[1])).abs() < 1e-3, "{latitude_deg} {at:?}: {apart}");
                }
                let (x, y) = (away([100.0, 0.0]), away([0.0, 100.0]));
                let across: f64 = x.iter().zip(y).map(|(a, b)| a * b).sum();
                assert!(across.abs() < 1.0, "{across}");
            }
        }
        // To the north the latitude increases; with x to the north, y points west.
        let globe = Globe::new(&SiteSection { latitude_deg: 34.0, longitude_deg: -118.0, azimuth_deg: 0.0 });
        let [latitude, longitude] = globe.at([10.0, 10.0]);
        assert!(latitude > 34.0 && longitude < -118.0);
    }
}
