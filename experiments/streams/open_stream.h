// Streams of depth images as commands name them: a folder, a recorded session, a simulated camera or a real
// one; and their first image as the model that renderers are prepared for.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include <palpate/cloud.h>
#include <palpate/depth_stream.h>
#include <palpate/progress.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include "experiments/streams/stream_feed.h"
#include "toolkit/stream/stock_scene.h"
#include "toolkit/stream/stream_statistics.h"

namespace palpate::experiments {

struct OpenStream {
  std::string name;  ///< as the user wrote it
  std::unique_ptr<stream::DepthSource> source;
  stream::DepthFrame first;  ///< the first that can be used; the source stands behind it
  /// Subtracted from the source's times: 0 where they belong to something else (the ticks of a recorded
  /// session, the motions of a simulated scene), else the first image's light.
  double begun_s = 0.0;
  bool is_camera = false;                   ///< next() waits for an image
  std::optional<stream::StockScene> known;  ///< what a simulated camera sees
  std::vector<std::string> unreadable;      ///< messages of the images before

  /// Times from the run's begin.
  void shift(stream::DepthFrame& frame) const noexcept {
    frame.captured_s -= begun_s;
    frame.arrived_s -= begun_s;
  }
};

/// The scene file that a simulated camera sees: "x.toml" of "sim:x.toml:width=320", empty of other streams.
[[nodiscard]] std::string simulated_file(const std::string& stream);

/// "room/", "session.palrec", "sim:wall", "sim:scene.toml", "openni". `readers`, which read organised point
/// clouds, must outlive it. Errors: there is no such stream, or no image in it.
[[nodiscard]] Result<OpenStream> open_stream(const std::string& name, const io::Readers& readers);

/// The measured pixels as points, world frame. An Error where there are none.
[[nodiscard]] Result<cloud::Cloud> cloud_of(const stream::DepthFrame& frame,
                                            const stream::DepthCamera& camera);

/// Memory of a run's images: 90 s of 640 x 480 at 30 Hz, half of a small machine's.
inline constexpr std::uint64_t kMostStreamBytes = std::uint64_t{7} << 29;

/// The images that arrive up to `until_s`, the first one among them. Images that cannot be read are left out
/// and named. Errors: they take more than kMostStreamBytes; cancelled.
[[nodiscard]] Result<StreamFrames> load_frames(OpenStream& open, double until_s, Progress& progress);

// Facts of a stream of depth images, for `palpate info`.

struct StreamFacts {
  std::string source, about;
  stream::DepthCamera camera;
  stream::StreamStatistics statistics;
};

/// Whether the name means a stream: a folder, a simulated camera or a real one. Recorded sessions are told
/// apart by what they hold.
[[nodiscard]] bool is_stream_name(const std::string& name);

/// Reads up to stream::kStatisticsFrames images.
[[nodiscard]] Result<StreamFacts> facts_of_stream(const std::string& name, const io::Readers& readers,
                                                  Progress& progress);
/// For a terminal.
[[nodiscard]] std::string to_text(const StreamFacts& facts);
/// An object of docs/schemas/info.schema.json.
[[nodiscard]] std::string to_json(const StreamFacts& facts);

}  // namespace palpate::experiments
