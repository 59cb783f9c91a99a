//! Drawn fields that no estimator has as its model, and ways to sample them.

use survey::grid::GridSample;

/// Uniform and normal random numbers from a seed (splitmix64, so that neighbouring seeds are independent).
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    pub fn below(&mut self, count: usize) -> usize {
        ((self.uniform() * count as f64) as usize).min(count - 1)
    }

    /// Box and Muller's transform.
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// Side of the square area, m.
pub const SIDE_M: f64 = 3.0;

/// A part of a field.
enum Part {
    /// A step of this height along a straight line through a point, with a normal.
    Step { at: [f64; 2], normal: [f64; 2], height: f64 },
    /// A box of this height with half sides, turned.
    Block { at: [f64; 2], half: [f64; 2], turn: [f64; 2], height: f64 },
    /// A plume downwind of its source: its width grows, its middle thins.
    Plume { at: [f64; 2], wind: [f64; 2], width: f64, strength: f64 },
    /// A Gaussian spot.
    Spot { at: [f64; 2], width: f64, strength: f64 },
    /// A plane.
    Plane { slope: [f64; 2] },
    /// A ramp between two levels.
    Ramp { at: [f64; 2], normal: [f64; 2], width: f64, height: f64 },
    /// A crest with a sharp top.
    Crest { at: [f64; 2], normal: [f64; 2], slope: f64 },
    /// A wave.
    Wave { number: [f64; 2], phase: f64, height: f64 },
}

fn along([x, y]: [f64; 2], at: [f64; 2], normal: [f64; 2]) -> f64 {
    (x - at[0]) * normal[0] + (y - at[1]) * normal[1]
}

impl Part {
    fn value(&self, p: [f64; 2]) -> f64 {
        match *self {
            Self::Step { at, normal, height } => f64::from(along(p, at, normal) > 0.0) * height,
            Self::Block { at, half, turn, height } => {
                let (u, v) = (along(p, at, turn), along(p, at, [-turn[1], turn[0]]));
                f64::from(u.abs() < half[0] && v.abs() < half[1]) * height
            }
            Self::Plume { at, wind, width, strength } => {
                let (u, v) = (along(p, at, wind), along(p, at, [-wind[1], wind[0]]));
                let spread = width + 0.2 * u.max(0.0);
                let upwind = if u < 0.0 { (-u * u / (2.0 * width * width)).exp() } else { 1.0 };
                strength * upwind * width / spread * (-v * v / (2.0 * spread * spread)).exp()
            }
            Self::Spot { at, width, strength } => {
                let d2 = (p[0] - at[0]).powi(2) + (p[1] - at[1]).powi(2);
                strength * (-d2 / (2.0 * width * width)).exp()
            }
            Self::Plane { slope } => slope[0] * p[0] + slope[1] * p[1],
            Self::Ramp { at, normal, width, height } => height * (along(p, at, normal) / width).tanh(),
            Self::Crest { at, normal, slope } => -slope * along(p, at, normal).abs(),
            Self::Wave { number, phase, height } => height * (number[0] * p[0] + number[1] * p[1] + phase).sin(),
        }
    }
}

/// Kind of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Edges,
    Plumes,
    Gradients,
    Mixed,
}

/// A drawn field.
pub struct Field {
    parts: Vec<Part>,
}

impl Field {
    pub fn draw(random: &mut Random) -> Self {
        let kind = [Kind::Edges, Kind::Plumes, Kind::Gradients, Kind::Mixed][random.below(4)];
        let mut parts = Vec::new();
        for of in [Kind::Edges, Kind::Plumes, Kind::Gradients] {
            if kind == of || kind == Kind::Mixed {
                for _ in 0..=random.below(3) {
                    parts.push(Self::part(of, random));
                }
            }
        }
        if kind == Kind::Edges {
            // no ground between edges is exactly level
            parts.push(Part::Plane { slope: [random.between(-0.3, 0.3), random.between(-0.3, 0.3)] });
        }
        Self { parts }
    }

    fn part(of: Kind, random: &mut Random) -> Part {
        let at = [random.between(0.0, SIDE_M), random.between(0.0, SIDE_M)];
        let angle = random.between(0.0, std::f64::consts::TAU);
        let normal = [angle.cos(), angle.sin()];
        let which = random.below(3);
        match of {
            Kind::Edges if which == 0 => Part::Step { at, normal, height: random.between(0.3, 1.5) },
            Kind::Edges => Part::Block {
                at,
                half: [random.between(0.2, 1.0), random.between(0.2, 1.0)],
                turn: normal,
                height: random.between(0.3, 1.5),
            },
            Kind::Plumes if which == 0 => {
                Part::Spot { at, width: random.between(0.15, 0.8), strength: random.between(0.5, 3.0) }
            }
            Kind::Plumes => {
                Part::Plume { at, wind: normal, width: random.between(0.1, 0.4), strength: random.between(0.5, 3.0) }
            }
            _ if which == 0 => {
                Part::Ramp { at, normal, width: random.between(0.1, 0.8), height: random.between(0.3, 1.5) }
            }
            _ if which == 1 => Part::Crest { at, normal, slope: random.between(0.2, 1.5) },
            _ => {
                let number = std::array::from_fn(|_| random.between(-4.0, 4.0));
                Part::Wave { number, phase: angle, height: random.between(0.2, 1.0) }
            }
        }
    }

    pub fn value(&self, p: [f64; 2]) -> f64 {
        self.parts.iter().map(|part| part.value(p)).sum()
    }

    /// Standard deviation over the area.
    pub fn spread(&self) -> f64 {
        let n = 40;
        let at = |i: usize| (i as f64 + 0.5) / n as f64 * SIDE_M;
        let values: Vec<f64> = (0..n * n).map(|k| self.value([at(k % n), at(k / n)])).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    }
}

/// Places of readings, one every few centimetres: rasters with straight lines, random places, a wandering path, or
/// lines across each other.
pub fn places(random: &mut Random) -> Vec<[f64; 2]> {
    let step_m = random.between(0.01, 0.03);
    let mut places = Vec::new();
    let mut line = |from: [f64; 2], to: [f64; 2]| {
        let length_m = (to[0] - from[0]).hypot(to[1] - from[1]);
        let count = (length_m / step_m).ceil().max(1.0);
        for i in 0..count as usize {
            let share = i as f64 / count;
            places.push(std::array::from_fn(|k| from[k] + share * (to[k] - from[k])));
        }
    };
    let raster = |pitch_m: f64, across: bool, line: &mut dyn FnMut([f64; 2], [f64; 2])| {
        for i in 0..(SIDE_M / pitch_m) as usize {
            let c = (i as f64 + 0.5) * pitch_m;
            if across { line([c, 0.0], [c, SIDE_M]) } else { line([0.0, c], [SIDE_M, c]) }
        }
    };
    match random.below(4) {
        0 => raster(random.between(0.1, 0.45), random.uniform() < 0.5, &mut line),
        1 => {
            let pitch_m = random.between(0.25, 0.6);
            raster(pitch_m, true, &mut line);
            raster(pitch_m, false, &mut line);
        }
        2 => {
            let mut at = [random.between(0.0, SIDE_M), random.between(0.0, SIDE_M)];
            for _ in 0..6 + random.below(20) {
                let to = [random.between(0.0, SIDE_M), random.between(0.0, SIDE_M)];
                line(at, to);
                at = to;
            }
        }
        _ => {
            let count = 150 + random.below(1200);
            places.extend((0..count).map(|_| [random.between(0.0, SIDE_M), random.between(0.0, SIDE_M)]));
        }
    }
    places
}

/// A field, its readings, and whether they state their noise.
pub fn survey(seed: u64) -> (Field, Vec<GridSample>) {
    let mut random = Random(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let mut field = Field::draw(&mut random);
    // nothing in view is no survey
    while field.spread() < 0.05 {
        field = Field::draw(&mut random);
    }
    let noise = field.spread() * 10.0_f64.powf(random.between(-2.0, -0.7));
    let stated = random.uniform() < 0.5;
    let samples = places(&mut random)
        .into_iter()
        .map(|at| GridSample {
            value_sigma: stated.then_some(noise),
            ..GridSample::at(at, field.value(at) + noise * random.normal())
        })
        .collect();
    (field, samples)
}
