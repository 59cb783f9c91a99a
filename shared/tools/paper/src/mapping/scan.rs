//! Scans flown in lockstep over a ground, and their maps.

use super::super::flight::{ClosedLoopFlight, DRIVES};
use super::super::random::Random;
use anyhow::{Context, Result, ensure};
use cable_robot::Vector3;
use lockstep::{Cycle, Lockstep};
use messages::PlanStatus;
use motor_box::GroundFile;
use motor_box::settings::ground_of;
use planner::Mission;
use planner::mission::{Leg, Polyline};
use planner::scan::{over_patches, raster};
use plant::ground::Ground;
use segments::motion_of;
use survey::adaptive::{KnownField, Merit, Patch, PatchOptions, patches};
use survey::grid::{GridMap, GridOptions, GridSample, GridSpec};

/// The ground file of the robot.
const GROUND: &str = include_str!("../../../../../configs/ground/fig10.toml");

/// Control period, s.
const PERIOD_S: f64 = 0.02;
/// Two delays and lags of the drives, and three cycles.
const HORIZON: u32 = 10;
/// Speed along the lines, m/s.
pub const SPEED_M_S: f64 = 0.35;
/// Height at which the node flies, m.
pub const HEIGHT_M: f64 = 0.9;

/// Period of the rangefinder, s; not a multiple of the control period.
pub const READING_S: f64 = 0.0125;
/// Latency of a reading, s: mean, which is known, and scatter.
pub const LATENCY_S: [f64; 2] = [0.040, 0.002];
/// Noise of a reading, m.
pub const NOISE_M: f64 = 0.005;
/// Width of the beam, degrees.
pub const BEAM_DEG: f64 = 2.0;

/// Side of a cell of the maps, m.
pub const CELL_M: f64 = 0.05;
/// Pitch of the coarse raster and range of influence of a sample, m.
pub const COARSE_M: f64 = 0.3;

/// Scanned area.
#[derive(Debug, Clone, Copy)]
pub struct Area {
    /// Lowest x and y, m.
    pub low_m: [f64; 2],
    /// Highest, m.
    pub high_m: [f64; 2],
}

/// A flown scan and its map.
pub struct Scan {
    /// The map.
    pub map: GridMap,
    /// Path of the setpoint, m.
    pub path: Vec<[f64; 2]>,
    /// Length of the path, m.
    pub length_m: f64,
    /// Duration, s.
    pub duration_s: f64,
    /// Patches of the second stage, if any.
    pub patches: Vec<Patch>,
    /// Index of the first path point of the second stage.
    pub second: usize,
    /// Samples of path length and RMSE of the map, m.
    pub rmse_by_length: Vec<[f64; 2]>,
}

/// Returns the diameter of the beam on the ground, m.
pub fn footprint_m() -> f64 {
    2.0 * (0.5 * BEAM_DEG.to_radians()).tan() * HEIGHT_M
}

/// Loads the ground.
pub fn ground() -> Result<Ground> {
    let file: GroundFile = toml::from_str(GROUND).context("configs/ground/fig10.toml")?;
    Ok(ground_of(&file))
}

/// Rangefinder whose readings of the true distance arrive late.
struct Rangefinder<'a> {
    ground: &'a Ground,
    random: Random,
    due_s: f64,
    before: Option<(f64, [f64; 3], [f64; 3])>,
}

impl Rangefinder<'_> {
    /// Passes the readings between the previous cycle and this one, each at the position interpolated from the
    /// estimates.
    fn readings(&mut self, cycle: &Cycle, mut take: impl FnMut(&GridSample)) {
        let now = (cycle.state.header.stamp_ns as f64 * 1e-9, cycle.truth_m, cycle.estimate.position_m);
        let Some(before) = self.before.replace(now) else {
            self.due_s = now.0;
            return;
        };
        while self.due_s <= now.0 {
            let [mean_s, scatter_s] = LATENCY_S;
            let told_s = self.due_s + mean_s + scatter_s * self.random.normal();
            let between = |time_s: f64, a: [f64; 3], b: [f64; 3]| {
                let share = (time_s - before.0) / (now.0 - before.0);
                [0, 1, 2].map(|k| a[k] + share * (b[k] - a[k]))
            };
            // The distance is measured at the true position; its assumed position uses the arrival time less the mean
            // latency.
            let (truth, seems) = (between(self.due_s, before.1, now.1), between(told_s - mean_s, before.2, now.2));
            let distance_m = self.ground.distance_m(truth, BEAM_DEG.to_radians()) + NOISE_M * self.random.normal();
            let covariance = cycle.estimate.covariance_m2;
            take(&GridSample {
                position_m: [seems[0], seems[1]],
                position_covariance_m2: [covariance[0], covariance[1], covariance[4]],
                value: seems[2] - distance_m,
                value_sigma: Some(NOISE_M),
                stamp_ns: (self.due_s * 1e9) as u64,
            });
            self.due_s += READING_S;
        }
    }
}

/// A scan in progress.
struct ScanFlight<'a> {
    lockstep: Lockstep,
    finder: Rangefinder<'a>,
    scan: Scan,
}

impl<'a> ScanFlight<'a> {
    fn new(area: &Area, ground: &'a Ground, start: Vector3<f64>) -> Result<Self> {
        let flight = ClosedLoopFlight {
            period_s: PERIOD_S,
            horizon: HORIZON,
            ..ClosedLoopFlight::new(start.into(), IDLE.to_owned(), DRIVES[0])
        };
        let mut lockstep = Lockstep::new(flight.scenario()?)?;
        lockstep.zero_and_arm()?;
        let spec = GridSpec::covering(area.low_m, area.high_m, CELL_M)?;
        let options = GridOptions { footprint_m: footprint_m(), reach_m: COARSE_M, least_sigma: 0.0 };
        let scan = Scan {
            map: GridMap::new(spec, options)?,
            path: Vec::new(),
            length_m: 0.0,
            duration_s: 0.0,
            patches: Vec::new(),
            second: 0,
            rmse_by_length: Vec::new(),
        };
        Ok(Self { lockstep, finder: Rangefinder { ground, random: Random::new(10), due_s: 0.0, before: None }, scan })
    }

    /// Flies lines through points and evaluates the map after every `each_m` of path.
    fn fly(&mut self, points: &[Vector3<f64>], each_m: f64) -> Result<()> {
        let points_m = points.iter().map(|point| <[f64; 3]>::from(*point).into());
        let mut leg: Vec<Leg> = Vec::new();
        let all: Vec<_> = points_m.collect();
        for some in all.chunks(planner::mission::MAX_POINTS) {
            leg.push(Leg::Polyline(Polyline { points_m: some.to_vec(), speed_m_s: Some(SPEED_M_S) }));
        }
        let mission = Mission { name: "scan".to_owned(), leg, ..Mission::parse(IDLE)? };
        self.lockstep.run(&mission).context("the planner rejected the scan")?;
        let planned_m: f64 = self.lockstep.planner().segments().iter().map(|segment| segment.path.length()).sum();
        let end_m = self.scan.length_m + planned_m;
        let mut next_m = self.scan.length_m + each_m;
        let mut last: Option<Vector3<f64>> = None;
        loop {
            let cycle = self.lockstep.cycle()?;
            let map = &mut self.scan.map;
            self.finder.readings(&cycle, |sample| {
                map.add(sample);
            });
            self.scan.duration_s += PERIOD_S;
            if let Some(motion) = motion_of(&cycle.motion) {
                let at = motion.setpoint(cycle.authority.plan_time_s).position;
                self.scan.length_m += last.map_or(0.0, |last| (at - last).norm());
                last = Some(at);
                if self.scan.path.last().is_none_or(|[x, y]| (x - at.x).hypot(y - at.y) > 0.02) {
                    self.scan.path.push([at.x, at.y]);
                }
            }
            if self.scan.length_m >= next_m {
                next_m += each_m;
                self.judge();
            }
            match cycle.plan.state {
                PlanStatus::STATE_DONE => break,
                PlanStatus::STATE_ABORTED => anyhow::bail!("the robot stopped on the way"),
                _ => {}
            }
        }
        // The setpoint is sampled once per cycle; the planned length is exact.
        ensure!((self.scan.length_m - end_m).abs() < 0.01 * end_m, "{} m of {end_m} m", self.scan.length_m);
        self.scan.length_m = end_m;
        self.judge();
        Ok(())
    }

    fn judge(&mut self) {
        self.scan.map.refresh();
        let error = MapErrors::compute(&self.scan.map, self.finder.ground, 0.0);
        self.scan.rmse_by_length.push([self.scan.length_m, error.all_m]);
    }
}

/// A mission without motion, as a base for others.
const IDLE: &str = "name = \"idle\"\n[[leg]]\ndwell = { duration_s = 1.0 }\n";

fn at_height([x, y]: [f64; 2]) -> Vector3<f64> {
    Vector3::new(x, y, HEIGHT_M)
}

/// Flies one raster with lines along x.
pub fn uniform(area: &Area, ground: &Ground, pitch_m: f64) -> Result<Scan> {
    let path = raster(at_height(area.low_m), at_height(area.high_m), pitch_m, Some(planner::scan::Axis::X))?;
    let mut flown = ScanFlight::new(area, ground, path[0])?;
    flown.fly(&path[1..], f64::INFINITY)?;
    flown.scan.map.refresh_all();
    Ok(flown.scan)
}

/// Flies a coarse raster, then fine ones with pitch `fine_m` where its map changes.
pub fn adaptive(area: &Area, ground: &Ground, fine_m: f64, share: f64) -> Result<Scan> {
    let path = raster(at_height(area.low_m), at_height(area.high_m), COARSE_M, Some(planner::scan::Axis::X))?;
    let mut flown = ScanFlight::new(area, ground, path[0])?;
    flown.fly(&path[1..], f64::INFINITY)?;
    flown.scan.second = flown.scan.path.len();
    let here = path[path.len() - 1];
    let options = PatchOptions { merit: Merit::Gradient, tile_m: 0.5 * COARSE_M, share, least: 0.2 };
    let chosen = patches(&KnownField::from(&flown.scan.map), area.low_m, area.high_m, [here.x, here.y], &options);
    let path = over_patches(&chosen, HEIGHT_M, fine_m, here)?;
    flown.scan.patches = chosen;
    flown.fly(&path, 4.0)?;
    flown.scan.map.refresh_all();
    flown.judge();
    Ok(flown.scan)
}

/// Errors of a map.
#[derive(Debug, Clone, Copy, Default)]
pub struct MapErrors {
    /// RMSE over every cell, m.
    pub all_m: f64,
    /// RMSE over the cells away from edges, m.
    pub away_m: f64,
    /// Share of the cells near an edge.
    pub near: f64,
    /// Number of unknown cells, which count as ground.
    pub unknown: usize,
    /// Share of all cells with an error within three of the map's standard deviations.
    pub within: f64,
}

impl MapErrors {
    /// Computes the errors of all cells, and of those farther than `band_m` from every edge.
    pub fn compute(map: &GridMap, ground: &Ground, band_m: f64) -> Self {
        let spec = map.spec();
        let (mut all, mut away, mut count, mut unknown, mut within) = (0.0, 0.0, 0usize, 0, 0usize);
        for (at, cell) in map.cells().iter().enumerate() {
            let place = spec.centre(at % spec.columns, at / spec.columns);
            let truth_m = ground.height_m(place);
            let value_m = cell.map_or(ground.ground_m, |cell| cell.value);
            unknown += usize::from(cell.is_none());
            let error = value_m - truth_m;
            within += usize::from(cell.is_some_and(|cell| error.abs() <= 3.0 * cell.sigma));
            all += error * error;
            if band_m > 0.0 && !near_edge(ground, place, band_m) {
                away += error * error;
                count += 1;
            }
        }
        let cells = spec.cells() as f64;
        Self {
            all_m: (all / cells).sqrt(),
            away_m: (away / count.max(1) as f64).sqrt(),
            near: 1.0 - count as f64 / cells,
            unknown,
            within: within as f64 / cells,
        }
    }
}

/// Returns whether the height of the ground differs within this distance, m; checked on rings a centimetre apart.
fn near_edge(ground: &Ground, place: [f64; 2], within_m: f64) -> bool {
    let height_m = ground.height_m(place);
    let rings = (within_m / 0.01).ceil().max(1.0);
    (1..=rings as usize).any(|ring| {
        let radius_m = within_m * ring as f64 / rings;
        (0..48).any(|step| {
            let angle = f64::from(step) * std::f64::consts::TAU / 48.0;
            let there = [place[0] + radius_m * libm::cos(angle), place[1] + radius_m * libm::sin(angle)];
            (ground.height_m(there) - height_m).abs() > 1e-9
        })
    })
}
