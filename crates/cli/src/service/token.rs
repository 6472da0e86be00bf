//! `raystream token`: the tokens of a service, in its data folder.

use crate::Outcome;
use crate::service::args::{
    DataArgs, TokenAddArgs, TokenCommand, TokenListArgs, TokenRevokeArgs, TokenRotateArgs,
};
use anyhow::{Context, Result, ensure};
use raystream_service::contract::{random_hex, write_private};
use raystream_service::coordinator::ledger::{Ledger, Quotas, Token, Usage, now_ms};
use raystream_service::coordinator::{AuditLog, DataFolder};
use raystream_service::http::TOKEN_FILE;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

const DAY_MS: i64 = 24 * 3_600_000;

/// Runs one of the commands.
pub fn run(command: &TokenCommand) -> Result<Outcome> {
    match command {
        TokenCommand::Add(args) => add(args),
        TokenCommand::List(args) => list(args),
        TokenCommand::Revoke(args) => revoke(args),
        TokenCommand::Rotate(args) => rotate(args),
    }?;
    Ok(Outcome::Done)
}

/// Calls with the ledger of a data folder, which a service may use meanwhile.
fn with_ledger<T>(of: &DataArgs, work: impl FnOnce(&Ledger) -> Result<T>) -> Result<T> {
    let (_used, ledger) = DataFolder::with_ledger(&of.data)?;
    work(&ledger)
}

fn add(args: &TokenAddArgs) -> Result<()> {
    let TokenAddArgs { of, name, tenant, role, days, output, .. } = args;
    let expires_ms = days.map(|days| now_ms() + i64::from(days) * DAY_MS);
    let text = random_hex()?;
    let quotas =
        Quotas { jobs: args.max_jobs, samples_a_day: args.samples_a_day, bytes_a_day: args.bytes_a_day };
    let tenant = tenant.as_ref().unwrap_or(name);
    let token = Token::new(name, *role, expires_ms)?.with_tenant(tenant).with_quotas(quotas);
    with_ledger(of, |ledger| {
        let is_new = ledger.add_token(token, Token::hash(&text))?;
        ensure!(is_new, "there is a token {name:?}; revoke or rotate it, or choose another name");
        note(of, "token add", json!({ "token": name, "tenant": tenant, "role": role }));
        Ok(())
    })?;
    tell(of, name, &text, output.as_ref())
}

/// Shows the text of a token, once.
fn tell(of: &DataArgs, name: &str, text: &str, output: Option<&PathBuf>) -> Result<()> {
    if let Some(path) = output {
        return write_private(path, text).with_context(|| path.display().to_string());
    }
    if of.json {
        stdout_line!("{}", json!({ "name": name, "token": text }));
    } else {
        stdout_line!("{text}");
    }
    Ok(())
}

fn list(args: &TokenListArgs) -> Result<()> {
    let tokens = with_ledger(&args.of, |ledger| {
        let tokens = ledger.tokens()?.into_iter();
        tokens.map(|token| Ok((ledger.usage(&token.tenant)?, token))).collect::<Result<Vec<_>>>()
    })?;
    for (used, token) in &tokens {
        if args.of.json {
            let mut shown = serde_json::to_value(token)?;
            shown["used"] = json!(used);
            stdout_line!("{shown}");
            continue;
        }
        let left = token.expires_ms.map(|end| end - now_ms());
        let end = match left {
            None => "never expires".to_owned(),
            Some(left) if left <= 0 => "has expired".to_owned(),
            Some(left) => format!("expires in {} h", left / 3_600_000),
        };
        stdout_line!("{:<20}  {:<20}  {:<6}  {end}", token.name, token.tenant, token.role.name());
        let Usage { jobs, samples, bytes } = used;
        let of = |most: Option<u64>| most.map_or_else(String::new, |most| format!(" of {most}"));
        let Quotas { jobs: most_jobs, samples_a_day, bytes_a_day } = token.quotas;
        stdout_line!(
            "  open jobs {jobs}{}, today {samples}{} samples and {bytes}{} bytes",
            of(most_jobs),
            of(samples_a_day),
            of(bytes_a_day)
        );
    }
    Ok(())
}

fn revoke(args: &TokenRevokeArgs) -> Result<()> {
    let TokenRevokeArgs { of, name, cookies } = args;
    with_ledger(of, |ledger| {
        if *cookies {
            ensure!(ledger.end_sessions(name, random_hex()?)?, "{}", missing(name));
            note(of, "token revoke --cookies", json!({ "token": name }));
            stdout_line!("the cookies of {name} have ended");
            return Ok(());
        }
        let file = file_of(&of.data, ledger, name)?;
        ensure!(ledger.revoke_token(name)?, "{}", missing(name));
        note(of, "token revoke", json!({ "token": name }));
        file.map_or(Ok(()), std::fs::remove_file)?;
        stdout_line!("{name} has ended");
        Ok(())
    })
}

fn rotate(args: &TokenRotateArgs) -> Result<()> {
    let TokenRotateArgs { of, name, output } = args;
    let text = random_hex()?;
    with_ledger(of, |ledger| {
        let file = file_of(&of.data, ledger, name)?;
        ensure!(ledger.rotate_token(name, Token::hash(&text), random_hex()?)?, "{}", missing(name));
        note(of, "token rotate", json!({ "token": name }));
        Ok(file.map_or(Ok(()), |path| write_private(&path, &text))?)
    })?;
    tell(of, name, &text, output.as_ref())
}

/// Writes down what the command did.
fn note(of: &DataArgs, what: &str, more: Value) {
    AuditLog::new(&of.data).note(what, more);
}

fn missing(name: &str) -> String {
    format!("there is no token {name:?}; `raystream token list` shows those that there are")
}

/// The file of the data folder that holds a token's text, if it does.
fn file_of(data: &Path, ledger: &Ledger, name: &str) -> Result<Option<PathBuf>> {
    let path = data.join(TOKEN_FILE);
    let Ok(text) = std::fs::read_to_string(&path) else { return Ok(None) };
    let token = ledger.token_of(&Token::hash(&text))?;
    Ok(token.is_some_and(|token| token.name == name).then_some(path))
}
