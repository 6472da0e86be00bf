//! Who asks: what the token or cookie of a request allows.

use super::state::State;
use crate::contract::Problem;
use crate::coordinator::ledger::{Charge, Exceeded, Job, JobFilter, Quotas, Role, Token};
use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;

/// The tenant of requests that need no token. No token can have it.
const TOKENLESS: &str = "(this machine)";

/// Whoever has sent a request that was let in.
#[derive(Clone, Debug)]
pub struct Caller {
    /// The token; `None` for a program of this machine that needs none.
    pub token: Option<Token>,
}

impl Caller {
    /// The tenant of the caller's jobs and scenes.
    pub fn tenant(&self) -> &str {
        self.token.as_ref().map_or(TOKENLESS, |token| &token.tenant)
    }

    /// The tenant whose jobs and scenes the caller may see; `None` for all.
    pub fn scope(&self) -> Option<&str> {
        (self.role() < Role::Admin).then(|| self.tenant())
    }

    /// All jobs that the caller may see.
    pub fn filter(&self) -> JobFilter {
        JobFilter { tenant: self.scope().map(str::to_owned), ..JobFilter::default() }
    }

    /// The job of a name, if the caller may see it.
    ///
    /// # Errors
    /// 404 if there is none, or it is another tenant's: no one is to know which.
    pub fn job(&self, state: &State, id: &str) -> Result<Job, Problem> {
        let job =
            state.ledger().job(id)?.filter(|job| self.scope().is_none_or(|tenant| tenant == job.tenant));
        job.ok_or_else(|| Problem::missing(format!("job {id:?}")))
    }

    /// The bytes of a scene, if the caller may see it. It counts as used, so it stays for now.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn scene(&self, state: &State, sha256: &str) -> Result<Option<u64>, Problem> {
        Ok(state.ledger().use_scene(self.scope(), sha256)?)
    }

    /// Bounds of what the caller's tenant may use.
    pub fn quotas(&self) -> Quotas {
        self.token.as_ref().map(|token| token.quotas).unwrap_or_default()
    }

    /// Counts what the caller uses.
    ///
    /// # Errors
    /// 429 or 422 beyond a quota; 503 if the ledger cannot be used.
    pub fn charge(&self, state: &State, charges: &[Charge]) -> Result<(), Problem> {
        let charged = state.ledger().charge(self.tenant(), self.quotas(), charges.to_vec())?;
        charged.map_err(over_quota)
    }

    /// True if the caller's token has neither been rotated nor revoked, nor has expired. Long answers ask for it.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn holds(&self, state: &State) -> Result<bool, Problem> {
        let Some(token) = &self.token else { return Ok(true) };
        let now = state.ledger().token(&token.name)?;
        Ok(now.is_some_and(|now| now.series == token.series && !now.has_expired()))
    }

    /// The token's name.
    pub fn name(&self) -> &str {
        self.token.as_ref().map_or("none", |token| &token.name)
    }

    /// The role of the caller.
    pub fn role(&self) -> Role {
        self.token.as_ref().map_or(Role::Submit, |token| token.role)
    }

    /// Refuses whoever may not do what a role may.
    ///
    /// # Errors
    /// 403.
    pub fn check(&self, needed: Role) -> Result<(), Problem> {
        let may = match needed {
            // Others see no one's measurements.
            Role::Metrics => matches!(self.role(), Role::Metrics | Role::Admin),
            _ => self.role() >= needed,
        };
        if may {
            return Ok(());
        }
        let detail = format!("this needs a token of the role {needed}, and yours has {}", self.role());
        Err(Problem::new(StatusCode::FORBIDDEN, detail))
    }
}

impl FromRequestParts<State> for Caller {
    type Rejection = Problem;

    /// Takes what the guard has left. A route without a guard has no caller.
    async fn from_request_parts(parts: &mut Parts, _: &State) -> Result<Self, Problem> {
        let caller = parts.extensions.get().cloned();
        caller.ok_or_else(|| {
            Problem::new(StatusCode::INTERNAL_SERVER_ERROR, "no one was asked for a token on this route")
        })
    }
}

/// The refusal of what goes beyond a quota: 422 if it always will, else 429.
pub fn over_quota(exceeded: Exceeded) -> Problem {
    let Exceeded { charge, most, used, day_ends_s } = exceeded;
    let (name, unit, asked) = match charge {
        Charge::Job => {
            let detail = format!(
                "the quota of your token is {most} jobs that have not ended, and {used} have not; wait until some \
                 have, or cancel some"
            );
            return Problem::limit(StatusCode::TOO_MANY_REQUESTS, "quota_jobs", most, detail).retry_after(10);
        }
        Charge::Samples(asked) => ("quota_samples_a_day", "samples (pixels × samples × frames)", asked),
        Charge::Bytes(asked) => ("quota_bytes_a_day", "bytes", asked),
    };
    if asked > most {
        let detail =
            format!("this has {asked} {unit}, and the quota of your token is {most} a day; ask for less");
        return Problem::limit(StatusCode::UNPROCESSABLE_ENTITY, name, most, detail);
    }
    let detail = format!(
        "this has {asked} {unit}; the quota of your token is {most} a day, and {used} are used. The next day begins \
         in {day_ends_s} s, at midnight UTC"
    );
    Problem::limit(StatusCode::TOO_MANY_REQUESTS, name, most, detail).retry_after(day_ends_s)
}
