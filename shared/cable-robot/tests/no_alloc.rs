//! Nothing a control loop calls allocates: a counting allocator watches every such function.
#![allow(clippy::unwrap_used, clippy::expect_used, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::hint::black_box;

use cable_robot::elastic::{equilibrium, realise};
use cable_robot::kinematics::{Jacobian, forward_kinematics, inverse_kinematics};
use cable_robot::law::{InputWeight, LqGain};
use cable_robot::limits::scale_to_limits;
use cable_robot::motor_model::{PRIOR, PhiModel, RIDGE};
use cable_robot::path::Spiral;
use cable_robot::profile::ProfileLimits;
use cable_robot::*;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: hands every call to the system's allocator unchanged; the count is a plain thread-local number.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|c| c.set(c.get() + 1));
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above, that is from the system's allocator.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(f: impl FnOnce()) -> u64 {
    let before = COUNT.with(Cell::get);
    f();
    COUNT.with(Cell::get) - before
}

fn robot(n: usize, stiffness_n: Option<f64>) -> Robot {
    let anchors_m = (0..n)
        .map(|i| {
            let angle = 2.0 * std::f64::consts::PI * i as f64 / n as f64;
            [5.0 + 5.0 * angle.cos(), 5.0 + 5.0 * angle.sin(), 5.0 + 0.1 * (i % 3) as f64]
        })
        .collect();
    Robot::new(RobotParts {
        anchors_m,
        node_mass_kg: 2.0,
        tension_limits_n: [0.5, 150.0],
        speed_limit_m_s: 0.4,
        acceleration_limit_m_s2: 0.5,
        stiffness_n,
        ..RobotParts::default()
    })
    .unwrap()
}

#[test]
fn the_counter_counts() {
    assert!(allocations(|| drop(black_box(vec![1, 2, 3]))) > 0);
}

#[test]
fn a_cycle_of_estimation_and_control_does_not_allocate() {
    for (n, stiffness) in [(3, None), (3, Some(6000.0)), (4, None), (4, Some(6000.0)), (8, Some(6000.0))] {
        let robot = robot(n, stiffness);
        let method = Distribution::default_for(n);
        let mut phi = PhiModel::new(10, RIDGE, PRIOR);
        let path = Path::Spiral(Spiral {
            centre: Vector3::new(5.0, 5.0, 1.0),
            start_radius_m: 0.0,
            end_radius_m: 0.6,
            turns: 3.0,
            rise_m: 1.125,
            start_angle_rad: 0.0,
        });
        let count = allocations(|| {
            let profile = Profile::plan(&path, &ProfileLimits::rest_to_rest(0.2, 0.4)).unwrap();
            let segment = Segment { id: 1, path, profile, start_s: 2.0 };
            let report = segment.check(&robot, method, 0.05).unwrap();
            black_box(report);
            let motion = Motion {
                current: segment,
                next: Some(Segment {
                    id: 2,
                    path: Path::Dwell(path.end()),
                    profile: Profile::dwell(1.0).unwrap(),
                    start_s: segment.end_s(),
                }),
            };
            let mut guess = path.start();
            for cycle in 0..200 {
                let setpoint = motion.setpoint(f64::from(cycle) * 0.15);
                let held = realise(&robot, &setpoint.position, &setpoint.acceleration, method).unwrap();
                let found = equilibrium(&robot, &held.unstretched_m, &setpoint.acceleration, Some(&guess)).unwrap();
                guess = found.position;
                black_box(found.covariance(&CableVec::repeat(n, 1e-3)));
                let lengths = inverse_kinematics(robot.anchors(), &setpoint.position);
                black_box(forward_kinematics(robot.anchors(), &lengths, Some(&guess)).unwrap());
                let jacobian = Jacobian::at(robot.anchors(), &guess).unwrap();
                let b = jacobian.node_jacobian().unwrap();
                let gain = LqGain::new(&b, 0.01, &Matrix3::identity(), &InputWeight::Scalar(1.0), 5).unwrap();
                let u = gain.velocity(&(setpoint.position - guess));
                let scaled = scale_to_limits(&u, &[0.4; 8]);
                phi.update(scaled.velocities_m_s[0], 0.9 * scaled.velocities_m_s[0]);
                black_box(phi.predict_length(5.0, 0.1, 0.01));
            }
            // Refusals are values too; only their text allocates.
            black_box(equilibrium(&robot, &[f64::NAN; 8][..n], &Vector3::zeros(), None).is_err());
            black_box(segment.check(&robot, method, f64::NAN).is_err());
        });
        assert_eq!(count, 0, "{n} cables, stiffness {stiffness:?}");
    }
}
