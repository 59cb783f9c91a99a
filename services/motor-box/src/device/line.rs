//! A device that sends its values in text lines.

#[derive(Debug)]
pub struct Template {
    text: String,
}

impl Template {
    pub fn new(text: &str) -> Self {
        Self { text: text.to_owned() }
    }

    /// Text line for these values. A template that begins with `$` gets the checksum of NMEA 0183: exclusive-or of all
    /// between `$` and `*`.
    pub fn line(&self, values: &[f64]) -> String {
        let mut line = self.text.clone();
        for (at, value) in values.iter().enumerate() {
            line = line.replace(&format!("{{{at}}}"), &format!("{value:.3}"));
        }
        if let Some(body) = line.strip_prefix('$') {
            let sum = body.bytes().fold(0, |sum, byte| sum ^ byte);
            line.push_str(&format!("*{sum:02X}"));
        }
        line.push_str("\r\n");
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_where_they_belong() {
        assert_eq!(Template::new("T={1} RH={0}").line(&[40.0, -21.25]), "T=-21.250 RH=40.000\r\n");
        // The checksum of a widely published sentence.
        let position = "$GPGLL,5300.97914,N,00259.98174,E,125926,A";
        assert_eq!(Template::new(position).line(&[]), format!("{position}*28\r\n"));
    }
}
