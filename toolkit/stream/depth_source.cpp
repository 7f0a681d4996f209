#include "toolkit/stream/depth_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <span>
#include <utility>
#include <vector>

#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/plugin_module.h"
#include "toolkit/core/statistics.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/io/byte_source.h"
#include "toolkit/io/decoding.h"
#include "toolkit/stream/camera_files.h"
#include "toolkit/stream/depth_codec.h"
#include "toolkit/stream/simulated_camera.h"

namespace palpate::stream {

// ---- folders

namespace {

namespace fs = std::filesystem;

/// Largest file of one image; kMaxImageSide squared as counts, stored without compression.
constexpr std::uint64_t kMaxImageBytes = std::uint64_t{1} << 28;
constexpr std::uint64_t kMaxIntrinsicsBytes = std::uint64_t{1} << 16;
/// Ten hours at 30 Hz.
constexpr std::size_t kMaxFrames = std::size_t{1} << 20;
constexpr double kTumCountsPerMetre = 5000.0, kOpen3dCountsPerMetre = 1000.0;
/// Some cameras write the largest count where they saw nothing.
constexpr std::uint16_t kNoCount = 0xFFFF;

constexpr const char* kTumImages = "depth.txt";
constexpr const char* kTumPoses = "groundtruth.txt";
constexpr const char* kOpen3dPoses = "trajectory.log";
constexpr const char* kOpen3dFolder = "depth";
constexpr std::string_view kTsdfBegin = "frame-", kTsdfImage = ".depth.png", kTsdfPose = ".pose.txt";
constexpr const char* kIntrinsicsFiles[] = {"camera-intrinsics.txt", "camera_intrinsic.json", "camera.json",
                                            "intrinsic.json"};

struct FrameFile {
  std::string image;
  std::uint64_t number = 0;
  double captured_s = 0.0;
  geometry::RigidTransform pose{};
  std::string pose_file{};  ///< read with the frame; empty: `pose`
};

/// The frames and how they are read.
struct FolderLayout {
  std::string name;
  std::vector<FrameFile> frames;
  double mm_per_count = 0.0;  ///< 0: PCD
  std::vector<std::string> remarks{};
};

/// False also where nobody may look.
bool is_there(const fs::path& file) {
  std::error_code code;
  return fs::exists(file, code);
}

Result<std::string> read_text(const fs::path& file, std::uint64_t most_bytes) {
  return read_file(file.string(), most_bytes);
}

/// Result of `parse` on a text file; its errors name the file.
template <class Parse>
auto parsed(const fs::path& file, std::uint64_t most_bytes, const Parse& parse)
    -> decltype(parse(std::string_view())) {
  PALPATE_ASSIGN(const std::string text, read_text(file, most_bytes));
  auto result = parse(std::string_view(text));
  if (!result) return std::move(result).error().in_file(file.string());
  return result;
}

class FolderSource final : public DepthSource {
 public:
  FolderSource(std::string folder, FolderLayout layout, DepthCamera camera, const io::Readers* readers)
      : folder_(std::move(folder)), layout_(std::move(layout)), camera_(camera), readers_(readers) {}

  [[nodiscard]] const DepthCamera& camera() const noexcept override { return camera_; }
  [[nodiscard]] Status restart() override {
    at_ = 0;
    return Done{};
  }
  [[nodiscard]] std::uint64_t frames() const noexcept override { return layout_.frames.size(); }
  [[nodiscard]] std::string describe() const override {
    std::string text = fmt::format("{} ({}): {} frames of {} x {}", folder_, layout_.name,
                                   layout_.frames.size(), camera_.width, camera_.height);
    for (const std::string& remark : layout_.remarks) text += "; " + remark;
    return text;
  }

  [[nodiscard]] Result<bool> next(DepthFrame& frame) override {
    if (at_ == layout_.frames.size()) return false;
    const FrameFile& file = layout_.frames[at_++];
    frame.number = file.number;
    frame.captured_s = frame.arrived_s = file.captured_s;
    frame.world_from_camera = file.pose;
    if (!file.pose_file.empty()) {
      PALPATE_ASSIGN(frame.world_from_camera, parsed(file.pose_file, kMaxIntrinsicsBytes, parse_pose));
    }
    if (Status read = read_depths(file.image, frame.depth_mm); !read)
      return std::move(read).error().in_file(file.image);
    return true;
  }

  /// Makes the camera the first image's: its size, and where intrinsics are not known the image's own.
  Status fit_camera(bool known_size, bool known_intrinsics) {
    const std::string& image = layout_.frames.front().image;
    if (layout_.mm_per_count == 0.0) {
      PALPATE_ASSIGN(const OrganisedPoints points, read_organised_pcd(image, readers_));
      if (known_intrinsics) {
        if (!known_size) {
          camera_.width = static_cast<int>(points.width);
          camera_.height = static_cast<int>(points.height);
        }
        return Done{};
      }
      Result<DepthCamera> fitted = camera_of(points);
      if (!fitted) return std::move(fitted).error().in_file(image);
      fitted->period_s = camera_.period_s;
      camera_ = *fitted;
      layout_.remarks.push_back(fmt::format("intrinsics from the points: f {:.2f} {:.2f}, c {:.2f} {:.2f}",
                                            camera_.fx_px, camera_.fy_px, camera_.cx_px, camera_.cy_px));
      return Done{};
    }
    if (Status read = read_counts(image, known_size); !read) return std::move(read).error().in_file(image);
    if (known_size) return Done{};
    const auto width = static_cast<int>(image_.width), height = static_cast<int>(image_.height);
    if (!known_intrinsics) {
      // A smaller image of the same camera: its outer borders stay where they are.
      const double sx = static_cast<double>(width) / camera_.width,
                   sy = static_cast<double>(height) / camera_.height;
      constexpr double kHalfPixel = 0.5;
      camera_.fx_px *= sx;
      camera_.fy_px *= sy;
      camera_.cx_px = (camera_.cx_px + kHalfPixel) * sx - kHalfPixel;
      camera_.cy_px = (camera_.cy_px + kHalfPixel) * sy - kHalfPixel;
      layout_.remarks.push_back(fmt::format("no file of intrinsics: f {:g}, c {:g} {:g} are assumed",
                                            camera_.fx_px, camera_.cx_px, camera_.cy_px));
    }
    camera_.width = width;
    camera_.height = height;
    return Done{};
  }

 private:
  Status read_counts(const std::string& image, bool of_camera) {
    PALPATE_ASSIGN(const std::string file, read_text(image, kMaxImageBytes));
    const ImageSize size{static_cast<std::uint32_t>(camera_.width),
                         static_cast<std::uint32_t>(camera_.height)};
    return read_depth_png(std::as_bytes(std::span(file)), of_camera ? size : ImageSize{}, image_);
  }
  Status read_depths(const std::string& image, std::vector<float>& depth_mm) {
    if (layout_.mm_per_count == 0.0) {
      PALPATE_ASSIGN(const OrganisedPoints points, read_organised_pcd(image, readers_));
      return depths_of(points, camera_, depth_mm);
    }
    PALPATE_TRY(read_counts(image, true));
    depth_mm.resize(image_.counts.size());
    for (std::size_t i = 0; i < depth_mm.size(); ++i)
      depth_mm[i] = image_.counts[i] == kNoCount
                        ? 0.0f
                        : static_cast<float>(layout_.mm_per_count * static_cast<double>(image_.counts[i]));
    return Done{};
  }

  std::string folder_;
  FolderLayout layout_;
  DepthCamera camera_;
  const io::Readers* readers_;
  DepthImage image_;
  std::size_t at_ = 0;
};

/// By name, whole numbers in it by their size: 9.png before 10.png.
bool comes_before(const fs::path& a, const fs::path& b) {
  const std::string x = a.string(), y = b.string();
  const auto digits_from = [](const std::string& text, std::size_t at) {
    return std::min(text.find_first_not_of("0123456789", at), text.size());
  };
  std::size_t i = 0, j = 0;
  while (i < x.size() && j < y.size()) {
    const std::size_t end_i = digits_from(x, i), end_j = digits_from(y, j);
    if (end_i == i || end_j == j) {
      if (x[i] != y[j]) return x[i] < y[j];
      ++i;
      ++j;
      continue;
    }
    // Without the zeros in front the longer number is the larger one.
    const std::size_t from_i = std::min(x.find_first_not_of('0', i), end_i),
                      from_j = std::min(y.find_first_not_of('0', j), end_j);
    if (end_i - from_i != end_j - from_j) return end_i - from_i < end_j - from_j;
    if (const int order = x.compare(from_i, end_i - from_i, y, from_j, end_j - from_j); order != 0)
      return order < 0;
    i = end_i;
    j = end_j;
  }
  const bool x_ends = i == x.size(), y_ends = j == y.size();
  return x_ends != y_ends ? x_ends : x < y;  // else they differ in zeros alone
}

/// Files of a folder that end so, in order.
std::vector<fs::path> files_ending(const fs::path& folder, std::string_view ending) {
  std::vector<fs::path> files;
  std::error_code failed;
  for (fs::directory_iterator it(folder, failed), end; !failed && it != end; it.increment(failed))
    if (it->path().string().ends_with(ending)) files.push_back(it->path());
  std::sort(files.begin(), files.end(), comes_before);
  return files;
}

void add_in_order(FolderLayout& layout, const std::vector<fs::path>& files) {
  for (const fs::path& file : files) layout.frames.push_back({file.string(), layout.frames.size()});
}

Result<FolderLayout> tum_layout(const fs::path& folder) {
  FolderLayout layout{"TUM RGB-D", {}, kMmPerMetre / kTumCountsPerMetre};
  PALPATE_ASSIGN(const std::vector<TimedFile> images,
                 parsed(folder / kTumImages, kMaxPoseFileBytes, parse_timed_files));
  const bool moves = is_there(folder / kTumPoses);
  std::vector<TimedPose> poses;
  if (moves) {
    PALPATE_ASSIGN(poses, parsed(folder / kTumPoses, kMaxPoseFileBytes, parse_timed_poses));
  }
  for (std::size_t i = 0; i < images.size(); ++i) {
    FrameFile frame{(folder / images[i].file).string(), i, images[i].t_s - images.front().t_s};
    if (moves) {
      const std::optional<geometry::RigidTransform> pose = pose_at(poses, images[i].t_s);
      if (!pose) continue;
      frame.pose = *pose;
    }
    if (!layout.frames.empty() && frame.captured_s == layout.frames.back().captured_s) continue;
    layout.frames.push_back(std::move(frame));
  }
  if (const std::size_t lost = images.size() - layout.frames.size(); lost > 0)
    layout.remarks.push_back(fmt::format("{} images without a pose or a time of their own left out", lost));
  layout.remarks.push_back(moves ? fmt::format("poses from {}", kTumPoses)
                                 : fmt::format("no {}: the camera stands still", kTumPoses));
  return layout;
}

Result<FolderLayout> tsdf_layout(const std::vector<fs::path>& images) {
  FolderLayout layout{"tsdf-fusion", {}, kMmPerMetre / kOpen3dCountsPerMetre};
  bool moves = false;
  std::int64_t first = 0;
  for (const fs::path& image : images) {
    const std::string name = image.filename().string();
    const std::string stem = name.substr(0, name.size() - kTsdfImage.size());
    const std::optional<std::int64_t> number =
        stem.starts_with(kTsdfBegin) ? io::parse_whole(stem.substr(kTsdfBegin.size())) : std::nullopt;
    if (!number || *number < 0)
      return Error{"the image has no number", "images are named frame-000000.depth.png and so on",
                   image.string()};
    if (layout.frames.empty()) first = *number;
    FrameFile frame{image.string(), static_cast<std::uint64_t>(*number - first)};
    if (const fs::path pose = image.parent_path() / (stem + std::string(kTsdfPose)); is_there(pose)) {
      frame.pose_file = pose.string();
      moves = true;
    }
    layout.frames.push_back(std::move(frame));
  }
  const std::size_t all = layout.frames.size();
  if (moves) std::erase_if(layout.frames, [](const FrameFile& frame) { return frame.pose_file.empty(); });
  if (layout.frames.size() < all)
    layout.remarks.push_back(fmt::format("{} images without a pose left out", all - layout.frames.size()));
  layout.remarks.push_back(moves ? "a pose beside each image"
                                 : "no poses beside the images: the camera stands still");
  return layout;
}

Result<FolderLayout> open3d_layout(const fs::path& folder, const std::vector<fs::path>& images) {
  FolderLayout layout{"Open3D", {}, kMmPerMetre / kOpen3dCountsPerMetre};
  add_in_order(layout, images);
  if (!is_there(folder / kOpen3dPoses)) {
    layout.remarks.push_back(fmt::format("no {}: the camera stands still", kOpen3dPoses));
    return layout;
  }
  PALPATE_ASSIGN(const std::vector<geometry::RigidTransform> poses,
                 parsed(folder / kOpen3dPoses, kMaxPoseFileBytes, parse_pose_log));
  if (poses.size() < images.size())
    layout.remarks.push_back(fmt::format("{} images without a pose left out", images.size() - poses.size()));
  layout.frames.resize(std::min(poses.size(), images.size()));
  for (std::size_t i = 0; i < layout.frames.size(); ++i) layout.frames[i].pose = poses[i];
  layout.remarks.push_back(fmt::format("poses from {}", kOpen3dPoses));
  return layout;
}

Result<FolderLayout> find_layout(const fs::path& folder) {
  if (is_there(folder / kTumImages)) return tum_layout(folder);
  if (const auto images = files_ending(folder, kTsdfImage); !images.empty()) return tsdf_layout(images);
  for (const fs::path& place : {folder / kOpen3dFolder, folder})
    if (const auto images = files_ending(place, ".png"); !images.empty())
      return open3d_layout(folder, images);
  FolderLayout layout{"organised PCD", {}, 0.0, {"the camera stands still"}};
  add_in_order(layout, files_ending(folder, ".pcd"));
  return layout;
}

/// Times of the frames: the file's, or their numbers at the rate.
void set_times(FolderLayout& layout, double rate_hz, DepthCamera& camera) {
  const bool timed = layout.frames.back().captured_s > 0.0;
  if (timed && rate_hz == 0.0) {
    std::vector<double> steps;
    for (std::size_t i = 1; i < layout.frames.size(); ++i)
      steps.push_back(layout.frames[i].captured_s - layout.frames[i - 1].captured_s);
    if (!steps.empty()) camera.period_s = upper_median(std::move(steps));
    return;
  }
  if (rate_hz > 0.0) camera.period_s = 1.0 / rate_hz;
  for (FrameFile& frame : layout.frames)
    frame.captured_s = static_cast<double>(frame.number) * camera.period_s;
}

/// Finds the layout, reads texts and the first image.
Result<std::unique_ptr<DepthSource>> open_depth_folder(const std::string& folder,
                                                       const DepthSourceOptions& options) {
  PALPATE_ASSIGN(FolderLayout layout, find_layout(folder));
  if (layout.frames.empty())
    return Error{"the folder has no depth images",
                 "it needs depth.txt, frame-000000.depth.png, depth/*.png, *.png or organised *.pcd", folder};
  if (layout.frames.size() > kMaxFrames)
    return Error{fmt::format("the folder has over {} images", kMaxFrames), "split it", folder};
  if (options.unit_mm_per_count > 0.0 && layout.mm_per_count > 0.0)
    layout.mm_per_count = options.unit_mm_per_count;
  DepthCamera camera = options.camera.value_or(DepthCamera{});
  bool known = options.camera.has_value(), sized = known;
  for (const char* name : kIntrinsicsFiles) {
    const fs::path file = fs::path(folder) / name;
    if (known || !is_there(file)) continue;
    PALPATE_TRY(parsed(file, kMaxIntrinsicsBytes,
                       [&](std::string_view text) { return parse_intrinsics(text, camera); }));
    known = true;
    sized = file.extension() == ".json";
    layout.remarks.push_back(fmt::format("intrinsics from {}", name));
  }
  set_times(layout, options.rate_hz, camera);
  auto source = std::make_unique<FolderSource>(folder, std::move(layout), camera, options.readers);
  PALPATE_TRY(source->fit_camera(sized, known));
  return std::unique_ptr<DepthSource>(std::move(source));
}

// ---- OpenNI2's cameras

constexpr std::size_t kOpenNiErrorBytes = 512;
constexpr const char* kGetPlugin =
    "build Palpate where libopenni2-dev is installed, and keep palpate_openni.so in lib/palpate/plugins "
    "beside the program's bin, or in a folder of PALPATE_PLUGINS";

fs::path openni_file() {
  std::error_code missing;
  for (const fs::path& folder : plugin_folders())
    if (fs::is_regular_file(folder / kOpenNiModule, missing)) return folder / kOpenNiModule;
  return kOpenNiModule;  // the run path, LD_LIBRARY_PATH, the system's folders
}

using LoadedOpenNi = std::shared_ptr<const OpenNiPlugin>;

/// Loads it once. It is never unloaded: its drivers' threads may outlast every camera.
Result<LoadedOpenNi> load_openni() {
  static LoadedOpenNi& kept = *new LoadedOpenNi();
  if (kept == nullptr) {
    PALPATE_ASSIGN(LoadedOpenNi loaded, load_plugin<OpenNiPlugin>(openni_file(), kOpenNiEntry, kOpenNiAbi));
    if (loaded->open == nullptr) return not_of_this_version(openni_file());
    kept = std::move(loaded);
  }
  return kept;
}

/// Opens a camera. The plug-in stays loaded until the program ends.
Result<std::unique_ptr<DepthSource>> open_openni(const std::string& name) {
  const Result<LoadedOpenNi> plugin = load_openni();
  if (!plugin)
    return Error{
        "OpenNI's cameras need the plug-in " + std::string(kOpenNiModule) + ": " + plugin.error().what,
        kGetPlugin};
  std::array<char, kOpenNiErrorBytes> error{};
  std::unique_ptr<DepthSource> source((*plugin)->open(name.c_str(), error.data(), error.size()));
  if (source != nullptr) return source;
  error.back() = '\0';
  return Error{"the camera " + shown(name) + " cannot be opened: " +
                   (error.front() != '\0' ? error.data() : "the plug-in does not say why"),
               "connect the camera, and close other programs that use it"};
}

}  // namespace

// ---- any source

Result<std::unique_ptr<DepthSource>> open_depth_source(const std::string& source,
                                                       const DepthSourceOptions& options) {
  const auto in = [](double value, const NumberRange& range) { return value >= 0.0 && value <= range.high; };
  if (!in(options.rate_hz, kRatesHz))
    return Error{"the rate of a stream is no number of frames a second", "give a rate " + text_of(kRatesHz)};
  if (!in(options.unit_mm_per_count, kScales))
    return Error{"the unit of depths is no length", "give the millimetres of one count, such as 1 or 0.2"};
  std::error_code none;
  if (std::filesystem::is_directory(source, none)) return open_depth_folder(source, options);
  if (source.starts_with(kSimulatedPrefix)) return open_simulated_camera(source);
  if (is_openni_name(source)) return open_openni(source);
  return Error{"there is no stream '" + source + "'",
               "give a folder of depth images or organised PCD files, sim:NAME, or openni"};
}

}  // namespace palpate::stream
