#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "colmap_lazyloc/math/rigid3.h"

namespace lazyloc {

// Rigs and frames as COLMAP 4 stores them with its models (rigs.bin, frames.bin). The numbers are the files'.
enum class SensorType : int32_t { CAMERA = 0, IMU = 1 };

// A camera's id as a sensor is its camera_id.
struct Sensor {
  SensorType type = SensorType::CAMERA;
  uint32_t sensor_id = 0;

  bool operator==(const Sensor& other) const { return type == other.type && sensor_id == other.sensor_id; }
  bool operator!=(const Sensor& other) const { return !(*this == other); }
};

struct RigSensor {
  Sensor sensor;
  std::optional<Rigid3d> sensor_from_rig;  // none: not calibrated
};

struct Rig {
  uint32_t rig_id = 0;
  std::optional<Sensor> reference;  // its frame is the rig's
  std::vector<RigSensor> others;
};

// Where the sensor is on the rig, if it is there and the rig says it. As in the files: normalise the rotation where it
// is computed with.
inline std::optional<Rigid3d> SensorFromRig(const Rig& rig, const Sensor& sensor) {
  if (rig.reference && *rig.reference == sensor) return Rigid3d();
  for (const RigSensor& other : rig.others) {
    if (other.sensor == sensor) return other.sensor_from_rig;
  }
  return std::nullopt;
}

// What one sensor of a rig recorded. A camera's data_id is the image_id.
struct FrameData {
  Sensor sensor;
  uint64_t data_id = 0;
};

// A rig at one moment.
struct ModelFrame {
  uint32_t frame_id = 0;
  uint32_t rig_id = 0;
  Rigid3d rig_from_world;
  std::vector<FrameData> data;
};

}  // namespace lazyloc
