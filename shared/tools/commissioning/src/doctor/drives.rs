//! What the drives themselves answer.

use crate::finding::{Finding, error, note};
use command::{Answer, Failure};
use config::{PortSection, SystemFile};
use motor_io::{CoreConfig, Trouble};

/// Time for the units of a port to be set up, s: silent ones are asked again twice a second.
const PATIENCE_S: f64 = 3.0;

/// Asks the drives on every real port.
///
/// # Errors
/// A system file that motor-io does not accept.
pub fn ask(file: &SystemFile) -> Answer<Vec<Finding>> {
    let robot = file.robot_file().map_err(Failure::bad)?;
    let config = CoreConfig::from_files(file, &robot).map_err(Failure::bad)?;
    let ports = file.motor_io.ports.iter().enumerate().filter(|(_, port)| !port.path.contains("{domain}"));
    Ok(ports.flat_map(|(index, port)| findings(index + 1, port, &config)).collect())
}

fn findings(number: usize, port: &PortSection, config: &CoreConfig) -> Vec<Finding> {
    let asked = match motor_io::open_port(port, &port.path, config) {
        Ok(mut bus) => motor_io::ask(&mut *bus, port.protocol, PATIENCE_S),
        Err(error) => Err(Trouble { sentence: error.to_string(), cure: "correct the system file" }),
    };
    match asked {
        Ok(units) => units
            .into_iter()
            .map(|asked| {
                let firmware = asked.firmware.as_deref().unwrap_or("a firmware that it does not state");
                note(format!("port {number}: {} answers, with {firmware}", asked.unit))
            })
            .collect(),
        Err(Trouble { sentence, cure }) => vec![error(format!("port {number}: {sentence}"), cure)],
    }
}
