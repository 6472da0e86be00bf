//! The processor's name.

/// Name, family and model of the processor, such as `AMD EPYC, family 26, model 2`. Virtual machines often shorten
/// the name; the numbers then still identify the generation. `None` where the system does not report them (systems
/// other than Linux, and ARM).
pub fn processor() -> Option<String> {
    named(&std::fs::read_to_string("/proc/cpuinfo").ok()?)
}

/// The first processor of `/proc/cpuinfo`.
fn named(text: &str) -> Option<String> {
    let field = |name: &str| {
        let mut fields = text.lines().filter_map(|line| line.split_once(':'));
        let (_, value) = fields.find(|(key, _)| key.trim() == name)?;
        Some(value.split_whitespace().collect::<Vec<_>>().join(" "))
    };
    let name = field("model name")?;
    Some(match (field("cpu family"), field("model")) {
        (Some(family), Some(model)) => format!("{name}, family {family}, model {model}"),
        _ => name,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_is_named_with_its_generation() {
        let text =
            "processor\t: 0\ncpu family\t: 26\nmodel\t\t: 2\nmodel name\t: AMD  EPYC\n\nprocessor\t: 1\n";
        assert_eq!(named(text).as_deref(), Some("AMD EPYC, family 26, model 2"));
        assert_eq!(named("processor\t: 0\nBogoMIPS\t: 243.75\n"), None);
    }
}
