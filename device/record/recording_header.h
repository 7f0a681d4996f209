// What a recording says once: about the session, and about every renderer that took part.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "device/interface/device.h"
#include "toolkit/geometry/rigid_transform.h"

namespace palpate::device {

/// Goes up when the layout changes.
inline constexpr std::uint32_t kRecordingVersion = 1;
inline constexpr const char* kRecordingEnding = "palrec";

/// A renderer that is tracked.
struct RecordedRenderer {
  std::string label;                                         ///< unique in its recording
  std::string name;                                          ///< in the registry
  std::vector<std::pair<std::string, std::string>> options;  ///< resolved, every one of them
};

struct RecordingHeader {
  std::string program;     ///< version and commit of what recorded
  std::string scene;       ///< as the user wrote it
  std::string scene_text;  ///< the scene file as it was; empty for a model alone
  std::string scene_hash;  ///< over everything that decides what is felt: models, surfaces, control
  std::string device;      ///< its name
  DeviceLimits limits;     ///< of the device, as it stated them when it was open
  geometry::RigidTransform world_from_device;  ///< p_world = rotation (scale p_device) + translation
  double scale = 1.0;                          ///< of the mapping: 1 is one to one
  std::string mapping;                         ///< in words: "one to one", "fitted", "factor 2.5", ..
  double rate_hz = 1000.0;
  std::string scheduling;   ///< what the servo obtained, in words; "virtual clock" where time was not real
  std::string machine;      ///< processor, kernel
  std::string started_utc;  ///< the clock's start, as 2026-01-31T12:00:00Z
  std::int64_t clock_start_ns = 0;  ///< what the machine's monotonic clock showed at the servo clock's 0
  /// What RecordedTick::decision means; 0 is "none".
  std::vector<std::string> decisions = {"none"};
};

}  // namespace palpate::device
