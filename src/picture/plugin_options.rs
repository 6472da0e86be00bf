//! Options that plug-ins declare, and their values.

use std::collections::BTreeMap;
use std::fmt::{self, Display};
use std::str::FromStr;

/// An option that a plug-in declares.
#[derive(Clone, Debug)]
pub(super) struct OptionSpec {
    pub key: String,
    pub default: String,
    pub help: String,
}

/// The values of a plug-in's options: those of the command line, else those of the scene file, else the defaults.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PluginOptions(BTreeMap<String, String>);

/// The reason why options cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OptionError {
    /// The value cannot be parsed.
    #[error("option {key}={value}: {reason}")]
    Invalid {
        /// The option.
        key: String,
        /// Its value.
        value: String,
        /// What the parser says.
        reason: String,
    },
    /// The option is not declared.
    #[error("{by} has no option {key:?}; {known}")]
    Unknown {
        /// Who was asked for it.
        by: String,
        /// The option.
        key: String,
        /// The options that there are.
        known: String,
    },
    /// Several plug-ins declare the option.
    #[error("--set {key}: {} have this option; write --set NAME.{key}=VALUE", .by.join(" and "))]
    Ambiguous {
        /// The option.
        key: String,
        /// The plug-ins that have it.
        by: Vec<String>,
    },
}

impl PluginOptions {
    /// The value of an option; `None` if the plug-in has not declared it.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.0.get(key).map(String::as_str)
    }

    /// The value of an option, parsed.
    ///
    /// # Errors
    /// If the value does not parse, or the plug-in has not declared the option.
    pub fn parse<T: FromStr<Err: Display>>(&self, key: &str) -> Result<T, OptionError> {
        let Some(value) = self.get(key) else {
            let known = format!("it declares {}", listed(self.0.keys()));
            return Err(OptionError::Unknown { by: "the plug-in".into(), key: key.into(), known });
        };
        value.trim().parse().map_err(|error: T::Err| OptionError::Invalid {
            key: key.into(),
            value: value.into(),
            reason: error.to_string(),
        })
    }

    /// All options and their values, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.0.iter().map(|(key, value)| (&**key, &**value))
    }

    /// The defaults.
    pub(super) fn of(specs: &[OptionSpec]) -> Self {
        Self(specs.iter().map(|spec| (spec.key.clone(), spec.default.clone())).collect())
    }

    /// Sets an option of a plug-in, which `by` names in the error.
    pub(super) fn set(&mut self, by: &str, key: &str, value: &str) -> Result<(), OptionError> {
        match self.0.get_mut(key) {
            Some(old) => value.clone_into(old),
            None => {
                let known = format!("it has {}", listed(self.0.keys()));
                return Err(OptionError::Unknown { by: by.into(), key: key.into(), known });
            }
        }
        Ok(())
    }
}

/// Names in a sentence.
fn listed<'a>(names: impl Iterator<Item = &'a String>) -> String {
    let names: Vec<&str> = names.map(String::as_str).collect();
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// `--set KEY=VALUE`, or `--set NAME.KEY=VALUE` for the integrator or the surface of this name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Setting {
    /// The integrator or the surface; `None` where the key says it.
    pub plugin: Option<String>,
    /// The option.
    pub key: String,
    /// Its value.
    pub value: String,
}

impl Display for Setting {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(plugin) = &self.plugin {
            write!(f, "{plugin}.")?;
        }
        write!(f, "{}={}", self.key, self.value)
    }
}

impl FromStr for Setting {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (left, value) = text.split_once('=').ok_or("write KEY=VALUE, or NAME.KEY=VALUE")?;
        // Names may contain dots, keys may not.
        let (plugin, key) = match left.trim().rsplit_once('.') {
            Some((plugin, key)) => (Some(plugin.to_owned()), key),
            None => (None, left.trim()),
        };
        if key.is_empty() || plugin.as_deref() == Some("") {
            return Err("write KEY=VALUE, or NAME.KEY=VALUE".into());
        }
        Ok(Self { plugin, key: key.to_owned(), value: value.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_name_their_plugin_or_not() {
        let setting = |text: &str| text.parse::<Setting>().map(|set| (set.plugin, set.key, set.value));
        let (key, value) = ("reach".to_owned(), "1=2".to_owned());
        assert_eq!(setting("reach=1=2"), Ok((None, key.clone(), value.clone())));
        assert_eq!(setting("wall.001.reach=1=2"), Ok((Some("wall.001".into()), key, value)));
        for bad in ["reach", "=1", ".reach=1", "wall.=1"] {
            assert!(setting(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn values_are_parsed_or_named() {
        let spec = OptionSpec { key: "reach".into(), default: "1.5".into(), help: String::new() };
        let mut options = PluginOptions::of(&[spec]);
        assert_eq!(options.parse("reach"), Ok(1.5f32));
        options.set("fog", "reach", "far").expect("declared");
        let error = options.parse::<f32>("reach").expect_err("no number").to_string();
        assert_eq!(error, "option reach=far: invalid float literal");
        let error = options.set("fog", "raech", "1").expect_err("misspelt").to_string();
        assert_eq!(error, r#"fog has no option "raech"; it has reach"#);
        let error = options.parse::<f32>("raech").expect_err("misspelt").to_string();
        assert_eq!(error, r#"the plug-in has no option "raech"; it declares reach"#);
    }
}
