"""simpla's platoons, from SUMO's own tools: the ego becomes the follower of the vehicle named
`lead`.

simpla writes to every vehicle of a platoon, so this needs `[simulation.conditions] interference =
"record"`.
"""

import tempfile

import simpla

CONFIGURATION = """<configuration>
  <controlRate value="10"/><verbosity value="0"/><vehicleSelectors value="ego,lead"/>
  <maxPlatoonGap value="60"/><catchupDist value="80"/><useHeadway value="false"/>
  <lcMode original="0" leader="0" follower="0" catchup="0" catchupFollower="0"/>
  <vTypeMap original="ego" leader="ego_leader" follower="ego_follower" catchup="ego_catchup"/>
  <vTypeMap original="lead" leader="lead_leader"/>
</configuration>"""


class Platoon:
    """Makes the vehicle types that simpla wants, lets SUMO drive the ego, starts simpla."""

    def reset(self, scenario, traci, ego):
        for role in ("leader", "follower", "catchup"):
            traci.vehicletype.copy("ego", f"ego_{role}")
        traci.vehicletype.copy("lead", "lead_leader")
        traci.vehicletype.setTau("ego_follower", 0.5)
        traci.vehicle.setSpeed(ego, -1)  # SUMO's car-following model drives
        # simpla 1.28 reads this before it sets it when vehicles are already on the road
        simpla._platoonmanager.PlatoonManager._controlInterval = 0.1
        with tempfile.NamedTemporaryFile("w", suffix=".cfg.xml") as file:
            file.write(CONFIGURATION)
            file.flush()
            simpla.load(file.name)

    def step(self, traci, ego, time):
        """simpla and SUMO drive."""

    def close(self):
        simpla.stop()
