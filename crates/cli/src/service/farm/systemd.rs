//! Services of systemd for the machines of a farm. Each reads its files in a folder below /etc/raystream.

use super::init::Record;

/// What all services are told: they see little of their machine, and may change nothing but folders of their own.
const CONFINED: &str = "ProtectSystem=strict\nProtectHome=true\nPrivateTmp=true\nNoNewPrivileges=true\n";

/// Starts a service at each start of the machine, and again when it fails.
const INSTALL: &str = "\n[Install]\nWantedBy=multi-user.target\n";

fn head(description: &str) -> String {
    format!(
        "[Unit]\nDescription={description}\nWants=network-online.target\nAfter=network-online.target\n\n[Service]\n"
    )
}

/// The NATS server. Its user is the one of Debian's package.
pub(super) fn of_server() -> String {
    let folder = "/etc/raystream/nats";
    format!(
        "{}# The files belong to the user: chown -R nats: {folder}\nUser=nats\nWorkingDirectory={folder}\n\
         ExecStart=nats-server -c nats.conf\n\
         ExecReload=kill -HUP $MAINPID\nRestart=always\nRestartSec=1\n{CONFINED}{INSTALL}",
        head("NATS server of a farm of raystream")
    )
}

/// The coordinator. Its user is made for it; systemd alone reads the key as it is on the disk.
pub(super) fn of_coordinator(record: &Record) -> String {
    let Record { farm, url } = record;
    let folder = "/etc/raystream/coordinator";
    format!(
        "{}DynamicUser=true\nStateDirectory=raystream\nStateDirectoryMode=0700\n\
         LoadCredential=nats.key:{folder}/nats.key\n\
         ExecStart=raystream serve --data /var/lib/raystream --nats {url} --farm {farm} \
         --nats-key ${{CREDENTIALS_DIRECTORY}}/nats.key --nats-ca {folder}/ca.pem\n\
         # Its first line has the token, which is no word for the journal.\n\
         StandardOutput=null\nStandardError=journal\n\
         Restart=on-failure\nRestartSec=2\n{CONFINED}{INSTALL}",
        head("Coordinator of a farm of raystream")
    )
}

/// A worker. It has half a minute to end or give back its units.
pub(super) fn of_worker(record: &Record, name: &str) -> String {
    let Record { farm, url } = record;
    let folder = "/etc/raystream/worker";
    format!(
        "{}DynamicUser=true\nCacheDirectory=raystream\nCacheDirectoryMode=0700\n\
         LoadCredential=nats.key:{folder}/nats.key\n\
         ExecStart=raystream worker --name {name} --cache /var/cache/raystream --nats {url} --farm {farm} \
         --nats-key ${{CREDENTIALS_DIRECTORY}}/nats.key --nats-ca {folder}/ca.pem\n\
         TimeoutStopSec=30\nRestart=on-failure\nRestartSec=5\n{CONFINED}{INSTALL}",
        head("Worker of a farm of raystream")
    )
}
