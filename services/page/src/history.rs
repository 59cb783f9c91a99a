//! The last ten minutes, for the charts of browsers that open later.

use crate::robot::Robot;
use serde_json::{Value, json};
use std::collections::VecDeque;

/// Least time between two rows, ns, and number of rows: ten minutes of two rows per second.
const STEP_NS: u64 = 490_000_000;
const ROWS: usize = 1200;

/// Rows of figures, oldest first.
#[derive(Debug, Default)]
pub(crate) struct History {
    rows: VecDeque<(u64, Value)>,
}

impl History {
    /// Adds a row, if the last one is old enough and motor-io publishes.
    pub(crate) fn note(&mut self, robot: &Robot, now_ns: u64) {
        let due = self.rows.back().is_none_or(|(last_ns, _)| now_ns >= last_ns + STEP_NS);
        let is_fresh = robot.age_s(now_ns).is_some_and(|age_s| age_s < 1.0);
        if !due || !is_fresh {
            return;
        }
        if self.rows.len() >= ROWS {
            self.rows.pop_front();
        }
        self.rows.push_back((now_ns, robot.figures(now_ns)));
    }

    /// All rows, each with its age, s.
    pub(crate) fn told(&self, now_ns: u64) -> Value {
        let age = |then_ns: u64| (now_ns.saturating_sub(then_ns) / 1_000_000) as f64 * 1e-3;
        let rows: Vec<Value> = self.rows.iter().map(|(then_ns, row)| json!([age(*then_ns), row])).collect();
        json!({ "type": "history", "rows": rows })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::{Header, MotorAuthority};

    #[test]
    fn it_holds_ten_minutes_and_no_time_without_a_robot() {
        let (mut robot, mut history) = (Robot::default(), History::default());
        history.note(&robot, STEP_NS);
        for step in 1..=ROWS as u64 + 100 {
            let header = Header { stamp_ns: step * STEP_NS, cycle: step, ..Header::default() };
            let authority = MotorAuthority { header, ..MotorAuthority::default() };
            robot.take("motor/authority", bytemuck::bytes_of(&authority));
            history.note(&robot, step * STEP_NS);
            history.note(&robot, step * STEP_NS + 1);
        }
        let end = (ROWS as u64 + 100) * STEP_NS;
        history.note(&robot, end + 10 * STEP_NS);
        let told = history.told(end);
        let rows = told["rows"].as_array().unwrap();
        assert_eq!((rows.len(), &rows[ROWS - 1][0], &rows[0][0]), (ROWS, &json!(0.0), &json!(587.51)));
        assert_eq!(rows[0][1]["mode"], "disarmed");
    }
}
