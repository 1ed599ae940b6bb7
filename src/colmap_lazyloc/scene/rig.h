#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// Type of a sensor in COLMAP 4's rigs.bin and frames.bin, by the same number as in the files.
enum class SensorType : int32_t { CAMERA = 0, IMU = 1 };

// Sensor of a rig. The sensor_id of a camera is its camera_id.
struct Sensor {
  SensorType type = SensorType::CAMERA;
  uint32_t sensor_id = 0;

  bool operator==(const Sensor& other) const { return type == other.type && sensor_id == other.sensor_id; }
  bool operator!=(const Sensor& other) const { return !(*this == other); }
};

struct RigSensor {
  Sensor sensor;
  std::optional<Rigid3d> sensor_from_rig;  // nullopt: not calibrated
};

// Rig as COLMAP 4 stores it with its models (rigs.bin).
struct Rig {
  uint32_t rig_id = 0;
  std::optional<Sensor> reference;  // sensor whose coordinate system is that of the rig
  std::vector<RigSensor> others;
};

inline std::vector<Sensor> SensorsOf(const Rig& rig) {
  std::vector<Sensor> sensors;
  if (rig.reference) sensors.push_back(*rig.reference);
  for (const RigSensor& other : rig.others) sensors.push_back(other.sensor);
  return sensors;
}

// Returns the pose of a sensor on its rig, with the bytes of the file: normalise the rotation before computing with it.
// Returns nullopt if the sensor is not on the rig or not calibrated.
inline std::optional<Rigid3d> SensorFromRig(const Rig& rig, const Sensor& sensor) {
  if (rig.reference && *rig.reference == sensor) return Rigid3d();
  for (const RigSensor& other : rig.others) {
    if (other.sensor == sensor) return other.sensor_from_rig;
  }
  return std::nullopt;
}

// Recording of one sensor of a rig. The data_id of a camera's recording is the image_id.
struct FrameData {
  Sensor sensor;
  uint64_t data_id = 0;
};

// Rig at one moment (COLMAP 4's frames.bin).
struct ModelFrame {
  uint32_t frame_id = 0;
  uint32_t rig_id = 0;
  Rigid3d rig_from_world;
  std::vector<FrameData> data;
};

}  // namespace lazyloc
