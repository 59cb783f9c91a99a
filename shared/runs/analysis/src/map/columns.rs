//! Names of columns and variables: a quantity with its unit, as `wind_speed_m_s`.

use messages::{Sample, text_of};

/// Signs of units that names cannot contain, and what stands for them.
const SIGNS: [(&str, &str); 6] = [("°", "deg"), ("µ", "u"), ("μ", "u"), ("²", "2"), ("³", "3"), ("%", "percent")];
/// Name of a quantity that has none.
const NAMELESS: &str = "value";

/// Returns the name of a quantity, with a word for what is stated of it, e.g. `sigma`, before its unit.
fn column([quantity, unit]: &[String; 2], of_it: &str) -> String {
    let quantity = if plain(quantity).is_empty() { NAMELESS.to_owned() } else { plain(quantity) };
    // A name begins with a letter.
    let quantity =
        if quantity.starts_with(|c: char| c.is_ascii_digit()) { format!("{NAMELESS}_{quantity}") } else { quantity };
    let words = [quantity, of_it.to_owned(), plain(unit)];
    words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_")
}

/// Returns the names of the mapped quantity and of its standard deviation, beside these other names.
pub(super) fn mapped(names: &[String; 2], others: &[&str]) -> [String; 2] {
    ["", "sigma"].map(|of_it| {
        let name = column(names, of_it);
        if others.contains(&name.as_str()) { format!("{NAMELESS}_{name}") } else { name }
    })
}

/// Returns the names of the first `count` values of samples such as this one; `value_N` where a name would not be the
/// only one, also beside those of the other columns.
pub(super) fn columns(sample: Option<&Sample>, count: usize, others: &[&str]) -> Vec<String> {
    let of = |pick: fn(&Sample) -> &[u8]| -> Vec<String> {
        let text = sample.map(|sample| text_of(pick(sample)).to_string()).unwrap_or_default();
        let words: Vec<String> = text.split(',').map(|word| word.trim().to_owned()).collect();
        (0..count).map(|at| words.get(at).cloned().unwrap_or_default()).collect()
    };
    let named: Vec<String> = of(|sample| &sample.quantity)
        .into_iter()
        .zip(of(|sample| &sample.unit))
        .map(|(q, u)| column(&[q, u], ""))
        .collect();
    let is_only = |name: &String| {
        name != NAMELESS && !others.contains(&name.as_str()) && named.iter().filter(|other| *other == name).count() == 1
    };
    named
        .iter()
        .enumerate()
        .map(|(at, name)| if is_only(name) { name.clone() } else { format!("{NAMELESS}_{}", at + 1) })
        .collect()
}

/// Returns a text in lower-case letters, digits and single underscores.
fn plain(text: &str) -> String {
    let spelled = SIGNS.iter().fold(text.to_owned(), |text, (sign, word)| text.replace(sign, word));
    let letters: String = spelled.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '_' }).collect();
    letters.split('_').filter(|word| !word.is_empty()).collect::<Vec<_>>().join("_")
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::put_text;

    #[test]
    fn a_name_carries_quantity_and_unit() {
        let name = |quantity: &str, unit: &str, of_it: &str| column(&[quantity.to_owned(), unit.to_owned()], of_it);
        assert_eq!(name("wind speed", "m/s", ""), "wind_speed_m_s");
        assert_eq!(name("wind speed", "m/s", "sigma"), "wind_speed_sigma_m_s");
        assert_eq!(name("temperature", "°C", ""), "temperature_degC");
        assert_eq!(name("moisture_percent", "", "sigma"), "moisture_percent_sigma");
        assert_eq!(name("", "", ""), "value");
        assert_eq!(name("2nd echo", "m²", ""), "value_2nd_echo_m2");
        assert_eq!(name("Füllstand, oben", "%", ""), "F_llstand_oben_percent");
    }

    #[test]
    fn no_two_columns_have_the_same_name() {
        let sample = |quantity: &str, unit: &str| {
            let mut sample = Sample { count: 3, ..Sample::default() };
            put_text(&mut sample.quantity, quantity);
            put_text(&mut sample.unit, unit);
            sample
        };
        assert_eq!(
            columns(Some(&sample("co2,temperature", "ppm,°C")), 3, &[]),
            ["co2_ppm", "temperature_degC", "value_3"]
        );
        assert_eq!(columns(Some(&sample("echo,echo,range", "m,m,m")), 3, &[]), ["value_1", "value_2", "range_m"]);
        let place = sample("latitude,x,echo", "°,m,m");
        assert_eq!(columns(Some(&place), 3, &["x_m", "latitude_deg"]), ["value_1", "value_2", "echo_m"]);
        assert_eq!(columns(None, 0, &[]), Vec::<String>::new());
    }
}
