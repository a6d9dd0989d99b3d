"""Fast DDS's profiles as XML (eProsima Fast DDS, "XML profiles"): what keeps it on the radio."""

from __future__ import annotations

__all__ = ["profile"]

# Two processes of one machine share /dev/shm even from different network namespaces; Fast DDS's default transports and
# data sharing would use it.
_PROFILES = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com"><profiles>
  <transport_descriptors>
    <transport_descriptor><transport_id>radio</transport_id><type>UDPv4</type></transport_descriptor>
  </transport_descriptors>
  <participant profile_name="radio" is_default_profile="true"><rtps>
    <userTransports><transport_id>radio</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
    <builtin>
      <discovery_config>{lease}</discovery_config>
      <initialPeersList><locator><udpv4><address>{peer}</address></udpv4></locator></initialPeersList>
    </builtin>
  </rtps></participant>
  <data_writer profile_name="writer" is_default_profile="true">
    <qos><data_sharing><kind>OFF</kind></data_sharing></qos>
    <times>{heartbeat_period}</times>
  </data_writer>
  <data_reader profile_name="reader" is_default_profile="true">
    <qos><data_sharing><kind>OFF</kind></data_sharing></qos>
  </data_reader>
</profiles></dds>
"""


def profile(peer: str, lease: float | None, heartbeat_period: float | None) -> str:
    """Profiles of participants that look for one peer, without multicast, over UDP alone.

    Args:
        peer: Its IPv4 address.
        lease: Time without a sign of life until a participant is given up (s), None for Fast DDS's own.
        heartbeat_period: Time between the heartbeats that writers send by themselves (s), None for Fast DDS's own.
    """
    times = {
        "lease": _duration("leaseDuration", lease),
        "heartbeat_period": _duration("heartbeat_period", heartbeat_period),
    }
    return _PROFILES.format(peer=peer, **times)


def _duration(name: str, time: float | None) -> str:
    if time is None:
        return ""
    seconds, nanoseconds = divmod(round(time * 1e9), 10**9)
    return f"<{name}><sec>{seconds}</sec><nanosec>{nanoseconds}</nanosec></{name}>"
