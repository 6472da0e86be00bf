"""Machines of a farm as network namespaces, each joined to a switch by a link of some rate. Linux, as root."""

import os
import shutil
import subprocess
import sys

# The coordinator's address in the farm, and for programs of this machine, whose packets take another way.
COORDINATOR, OUTSIDE, HERE = "10.77.0.1", "10.78.0.1", "10.78.0.2"


class Links:
    """A switch with the links of `coordinator` and of other machines, each of so many megabits a second and direction.

    A link carries no more than its rate, by a token bucket at both ends. This machine is joined to the coordinator by a
    link of its own without a limit: what programs here ask of it is no traffic of the farm.
    """

    def __init__(self, megabits, machines):
        self.prefix, self.spaces, self.machines = f"rs{os.getpid() % 100_000}", [], list(machines)
        self.addresses = {"coordinator": COORDINATOR}
        self.addresses |= {name: f"10.77.0.{place}" for place, name in enumerate(machines, 2)}
        if not shutil.which("ip") or not shutil.which("tc"):
            sys.exit("there are no commands ip and tc: install iproute2")
        try:
            self.add("switch")
            self.run("ip -n {switch} link add bridge type bridge")
            self.run("ip -n {switch} link set bridge up")
            for place, (name, address) in enumerate(self.addresses.items()):
                self.add(name)
                own, port = f"-n {self.space(name)}", f"-n {self.space('switch')}"
                self.run(f"ip {own} link add eth0 type veth peer name port{place} netns {self.space('switch')}")
                self.run(f"ip {own} address add {address}/24 dev eth0")
                self.run(f"ip {port} link set port{place} master bridge")
                for space, device in [(own, "eth0"), (port, f"port{place}")]:
                    if megabits:
                        # Two milliseconds of the rate may pass at once, and a tenth of a second of it may wait.
                        burst = max(64_000, int(megabits * 1e6 / 8 * 0.002))
                        bucket = f"rate {megabits}mbit burst {burst} latency 100ms"
                        self.run(f"tc {space} qdisc add dev {device} root tbf {bucket}")
                    self.run(f"ip {space} link set {device} up")
                self.run(f"ip {own} link set lo up")
            inside = f"-n {self.space('coordinator')}"
            self.run(f"ip link add {self.prefix} type veth peer name outside netns {self.space('coordinator')}")
            self.run(f"ip address add {HERE}/24 dev {self.prefix}")
            self.run(f"ip link set {self.prefix} up")
            self.run(f"ip {inside} address add {OUTSIDE}/24 dev outside")
            self.run(f"ip {inside} link set outside up")
        except BaseException:
            self.remove()
            raise

    def space(self, name):
        return f"{self.prefix}-{name}"

    def add(self, name):
        self.run(f"ip netns add {self.space(name)}")
        self.spaces.append(self.space(name))

    def run(self, command):
        words = command.format(switch=self.space("switch")).split()
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            sys.exit(f"{' '.join(words)}: {done.stderr.strip()}; run this as root, on a kernel with these parts")

    def of(self, name):
        """What makes a command one that runs on a machine."""
        return lambda words: ["ip", "netns", "exec", self.space(name), *map(str, words)]

    def remove(self):
        # With a namespace its links go.
        for space in self.spaces:
            subprocess.run(["ip", "netns", "del", space], capture_output=True)
