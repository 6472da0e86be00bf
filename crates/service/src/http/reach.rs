//! Addresses that the service may call for a client. A client names any host, and a host's name leads anywhere: to
//! this machine, to its neighbours, to a cloud's own addresses. So what a name leads to is checked where the
//! connection is made, with the addresses that it is made to.

use ipnet::{IpNet, Ipv4Net, Ipv6Net};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use ureq::config::Config;
use ureq::http::Uri;
use ureq::unversioned::resolver::{DefaultResolver, ResolvedSocketAddrs, Resolver};
use ureq::unversioned::transport::NextTimeout;

/// Networks of IPv4 that are not public, by IANA's registry of special purposes, with what all listen to.
const SPECIAL_V4: [([u8; 4], u8); 16] = [
    ([0, 0, 0, 0], 8),
    ([10, 0, 0, 0], 8),
    ([100, 64, 0, 0], 10),
    ([127, 0, 0, 0], 8),
    ([169, 254, 0, 0], 16),
    ([172, 16, 0, 0], 12),
    ([192, 0, 0, 0], 24),
    ([192, 0, 2, 0], 24),
    ([192, 88, 99, 0], 24),
    ([192, 168, 0, 0], 16),
    ([198, 18, 0, 0], 15),
    ([198, 51, 100, 0], 24),
    ([203, 0, 113, 0], 24),
    ([224, 0, 0, 0], 4),
    ([240, 0, 0, 0], 4),
    ([255, 255, 255, 255], 32),
];

/// The network of public addresses of IPv6, and the networks in it that are not: protocols' own (Teredo and others),
/// examples, 6to4, whose addresses hold any of IPv4.
const PUBLIC_V6: (u128, u8) = (0x2000 << 112, 3);
const SPECIAL_V6: [(u128, u8); 4] =
    [(0x2001 << 112, 23), (0x2001_0db8 << 96, 32), (0x2002 << 112, 16), (0x3fff << 112, 20)];

/// The network of IPv6 whose addresses end with those of IPv4 that a gateway leads to.
const GATEWAYS: (u128, u8) = (0x0064_ff9b << 96, 96);

/// The addresses that may be called.
#[derive(Clone, Debug, Default)]
pub struct Reach {
    allowed: Vec<IpNet>,
}

impl Reach {
    /// Public addresses, and these networks.
    pub fn new(allowed: Vec<IpNet>) -> Self {
        Self { allowed }
    }

    /// True if an address may be called.
    pub fn admits(&self, address: IpAddr) -> bool {
        // `::ffff:127.0.0.1` is this machine.
        let address = address.to_canonical();
        self.allowed.iter().any(|network| network.contains(&address)) || is_public(address)
    }

    /// True if the host of an address is a name, or an IP address that may be called.
    pub fn may_admit(&self, uri: &Uri) -> bool {
        let host = uri.host().unwrap_or_default().trim_matches(['[', ']']);
        host.parse().map_or(true, |address| self.admits(address))
    }
}

/// True if an address is anyone's on the internet.
fn is_public(address: IpAddr) -> bool {
    match address {
        IpAddr::V4(address) => {
            let special =
                |&(start, length)| Ipv4Net::new_assert(Ipv4Addr::from(start), length).contains(&address);
            !SPECIAL_V4.iter().any(special)
        }
        IpAddr::V6(address) => {
            let holds =
                |(start, length)| Ipv6Net::new_assert(Ipv6Addr::from(start), length).contains(&address);
            if holds(GATEWAYS) {
                let [.., a, b, c, d] = address.octets();
                return is_public(Ipv4Addr::new(a, b, c, d).into());
            }
            holds(PUBLIC_V6) && !SPECIAL_V6.into_iter().any(holds)
        }
    }
}

/// Finds the addresses of hosts and leaves those that may not be called. Connections are made to what it returns, so no
/// name can lead to another address after it was checked.
impl Resolver for Reach {
    fn resolve(
        &self,
        uri: &Uri,
        config: &Config,
        timeout: NextTimeout,
    ) -> Result<ResolvedSocketAddrs, ureq::Error> {
        let found = DefaultResolver::default().resolve(uri, config, timeout)?;
        let mut admitted = self.empty();
        found.iter().filter(|found| self.admits(found.ip())).for_each(|found| admitted.push(*found));
        if admitted.is_empty() {
            let host = uri.host().unwrap_or_default();
            log::warn!("{host}: leads to {:?} alone, where no webhook may go", &found[..]);
            return Err(ureq::Error::Other(Box::new(Unreachable)));
        }
        Ok(admitted)
    }
}

/// No address of a host may be called. It does not say which they are: names of an inner network tell who is there.
#[derive(Debug, thiserror::Error)]
#[error("the host has no public address; whoever runs the service may allow others (--webhook-network)")]
pub struct Unreachable;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn public_addresses_and_allowed_networks_are_admitted() {
        let reach =
            Reach::new(vec!["10.1.0.0/16".parse().expect("a network"), "fd00::/64".parse().expect("one")]);
        for admitted in
            ["8.8.8.8", "100.63.255.255", "172.32.0.1", "10.1.2.3", "::ffff:10.1.2.3", "::ffff:8.8.8.8"]
                .into_iter()
                .chain(["2606:4700::1111", "fd00::1", "64:ff9b::8.8.8.8", "2400:cb00::1"])
        {
            assert!(reach.admits(admitted.parse().expect("an address")), "{admitted}");
        }
        for refused in ["127.0.0.1", "127.1.2.3", "0.0.0.0", "10.2.0.1", "172.16.0.1", "172.31.255.255"]
            .into_iter()
            .chain(["192.168.1.1", "169.254.169.254", "100.64.0.1", "100.127.255.255", "224.0.0.1"])
            .chain(["255.255.255.255", "240.0.0.1", "192.0.2.1", "198.18.0.1", "198.51.100.7", "203.0.113.9"])
            .chain(["::", "::1", "fe80::1", "fc00::1", "fd00:ec2::254", "fec0::1", "ff02::1", "::127.0.0.1"])
            .chain(["::ffff:127.0.0.1", "::ffff:169.254.169.254", "64:ff9b::127.0.0.1", "64:ff9b:1::1"])
            .chain(["2002:7f00:1::", "2001::1", "2001:db8::1", "3fff::1", "100::1", "5f00::1"])
        {
            assert!(!reach.admits(refused.parse().expect("an address")), "{refused}");
        }
        let may = |uri: &str| reach.may_admit(&uri.parse().expect("an address"));
        assert!(may("http://hooks.example/") && may("https://10.1.0.9:8080/x") && may("http://[fd00::7]/"));
        assert!(
            !may("http://127.0.0.1/") && !may("http://u@[::ffff:127.0.0.1]:80/") && !may("http://[::1]/")
        );
    }
}
