"""Fast DDS's profiles as XML (eProsima Fast DDS, "XML profiles"): what keeps it on the radio."""

from __future__ import annotations

__all__ = ["profile"]

# Two processes of one machine share /dev/shm even from different network namespaces; Fast DDS's default transports and
# data sharing would use it. The lease outlasts a run, so that nothing is discovered again within it.
_PROFILES = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com"><profiles>
  <transport_descriptors>
    <transport_descriptor><transport_id>radio</transport_id><type>UDPv4</type></transport_descriptor>
  </transport_descriptors>
  <participant profile_name="radio" is_default_profile="true"><rtps>
    <userTransports><transport_id>radio</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
    <builtin>
      <discovery_config><leaseDuration><sec>600</sec></leaseDuration></discovery_config>
      <initialPeersList><locator><udpv4><address>{peer}</address></udpv4></locator></initialPeersList>
    </builtin>
  </rtps></participant>
  <data_writer profile_name="writer" is_default_profile="true">
    <qos><data_sharing><kind>OFF</kind></data_sharing></qos>
  </data_writer>
  <data_reader profile_name="reader" is_default_profile="true">
    <qos><data_sharing><kind>OFF</kind></data_sharing></qos>
  </data_reader>
</profiles></dds>
"""


def profile(peer: str) -> str:
    """Profiles of participants that look for one peer at an IPv4 address, without multicast, over UDP alone."""
    return _PROFILES.format(peer=peer)
