//! What the drives themselves answer.

use crate::finding::{Finding, error, note};
use command::{Answer, Failure};
use config::{PortSection, SystemFile};
use motor_io::{CoreConfig, Trouble};

/// Time for the units of a port to be set up, s: silent ones are asked again twice a second.
const PATIENCE_S: f64 = 3.0;

/// What is to be set in the makers' programs, for every real port.
pub fn to_set(file: &SystemFile) -> Vec<Finding> {
    let say =
        |(number, port): (usize, &PortSection)| note(format!("port {number}: set {}", port.protocol.family().set));
    real(file).map(say).collect()
}

fn real(file: &SystemFile) -> impl Iterator<Item = (usize, &PortSection)> {
    let numbered = file.motor_io.ports.iter().enumerate().map(|(index, port)| (index + 1, port));
    numbered.filter(|(_, port)| !port.path.contains("{domain}"))
}

/// Asks the drives on every real port.
///
/// # Errors
/// A system file that motor-io does not accept.
pub fn ask(file: &SystemFile) -> Answer<Vec<Finding>> {
    let robot = file.robot_file().map_err(Failure::bad)?;
    let config = CoreConfig::from_files(file, &robot).map_err(Failure::bad)?;
    Ok(real(file).flat_map(|(number, port)| findings(number, port, &config)).collect())
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
