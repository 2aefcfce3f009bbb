"""An autopilot's data as samples: MAVLink, DataFlash, ULog, MAVROS and px4_msgs through one set of tables; no ROS."""
