"""Fast DDS's profiles as XML (eProsima Fast DDS, "XML profiles"): what keeps it on the radio."""

from __future__ import annotations

__all__ = ["profile"]

# Two processes of one machine share /dev/shm even from different network namespaces, and by default Fast DDS would use
# it for its transport and for data sharing. The lease outlasts a run, so that nothing is discovered again within it.
_PROFILES = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com"><profiles>
  <transport_descriptors>
    <transport_descriptor><transport_id>radio</transport_id><type>UDPv4</type></transport_descriptor>
  </transport_descriptors>
  <participant profile_name="radio" is_default_profile="true"><rtps>
    {transports}<builtin>
      <discovery_config><leaseDuration><sec>600</sec></leaseDuration></discovery_config>
      <initialPeersList><locator><udpv4><address>{peer}</address></udpv4></locator></initialPeersList>
    </builtin>
  </rtps></participant>
  <data_writer profile_name="writer" is_default_profile="true">
    <qos><data_sharing><kind>{sharing}</kind></data_sharing></qos>
  </data_writer>
  <data_reader profile_name="reader" is_default_profile="true">
    <qos><data_sharing><kind>{sharing}</kind></data_sharing></qos>
  </data_reader>
</profiles></dds>
"""
_UDP_ALONE = """<userTransports><transport_id>radio</transport_id></userTransports>
    <useBuiltinTransports>false</useBuiltinTransports>
    """


def profile(peer: str, shared_memory: bool) -> str:
    """Profiles of participants that look for their peer at an IPv4 address, over UDP alone unless told otherwise."""
    return _PROFILES.format(
        transports="" if shared_memory else _UDP_ALONE, peer=peer,
        sharing="AUTOMATIC" if shared_memory else "OFF",
    )  # fmt: skip
