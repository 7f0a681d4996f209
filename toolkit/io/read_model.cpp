#include <palpate/read_model.h>

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <new>
#include <stdexcept>
#include <tuple>

#include "toolkit/core/hash.h"
#include "toolkit/io/decoding.h"
#include "toolkit/io/read_e57.h"
#include "toolkit/io/read_las.h"
#include "toolkit/io/read_ptx.h"

namespace palpate::io {
namespace {

// The guess of the unit, from the numbers of the file alone. Scans come in metres or in millimetres.
// A scanned object under 10 mm across is rarer than a scanned object or room under 10 m.
constexpr double kMetresBelowDiagonal = 10.0;
// Coordinates so much larger than the box are geographic (UTM northings reach 1e7 over some km), hence
// metres.
constexpr double kGeographicOffset = 1000.0;

struct Guess {
  Unit unit;
  std::string why;
};

Guess guess_unit(const DecodedFile& decoded) {
  if (decoded.conventional_unit)
    return {*decoded.conventional_unit, fmt::format("{} is in this unit by convention", decoded.format)};
  geometry::Aabb box;
  for (const Vec3& p : decoded.points) {
    if (is_finite(p)) box.add(p);
  }
  const double diagonal = box.extent_mm().norm();
  const double farthest =
      box.empty() ? 0.0 : std::max(box.low_mm.cwiseAbs().maxCoeff(), box.high_mm.cwiseAbs().maxCoeff());
  if (diagonal > 0.0 && farthest > kGeographicOffset * diagonal)
    return {Unit::kMetre,
            fmt::format("its coordinates (up to {:.4g}) are over {:g} times larger than its box, as "
                        "geographic ones are",
                        farthest, kGeographicOffset)};
  if (diagonal < kMetresBelowDiagonal)
    return {Unit::kMetre,
            fmt::format("its box has the diagonal {:.4g}, below {:g}", diagonal, kMetresBelowDiagonal)};
  return {Unit::kMillimetre,
          fmt::format("its box has the diagonal {:.4g}, not below {:g}", diagonal, kMetresBelowDiagonal)};
}

void choose_unit(const DecodedFile& decoded, const ReadOptions& options, ReadModel& model) {
  if (options.unit) {
    model.unit = *options.unit;
    if (decoded.unit && *decoded.unit != *options.unit)
      model.warnings.push_back(fmt::format("The file says its unit is {}, read as {} as asked.",
                                           unit_name(*decoded.unit), unit_name(*options.unit)));
  } else if (decoded.unit) {
    model.unit = *decoded.unit;
  } else {
    const Guess guess = guess_unit(decoded);
    model.unit = guess.unit;
    model.unit_guessed = true;
    model.warnings.push_back(
        fmt::format("The file does not say its unit; guessed {} because {}. Give it with --unit "
                    "or unit= (m, cm, mm, um, in) if that is wrong.",
                    unit_name(guess.unit), guess.why));
  }
}

constexpr std::uint32_t kDropped = 0xFFFFFFFFu, kOutside = kDropped - 1;

struct Compacted {
  std::vector<std::uint32_t> new_index;  ///< of every point; empty: all were kept
  std::size_t first_bad = 0;
  geometry::Aabb finite_mm;  ///< of all finite points, kept or not
};

// Scales to mm and closes the gaps of points that are not finite, or outside the box asked for.
Compacted scale_and_compact(DecodedFile& decoded, double factor, const ReadOptions& options,
                            ReadModel& model) {
  Compacted made;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < decoded.points.size(); ++i) {
    const Vec3 p = decoded.points[i] * factor;
    const bool finite = is_finite(p);
    if (finite) made.finite_mm.add(p);
    if (!finite || (options.within_mm && !options.within_mm->contains(p))) {
      if (made.new_index.empty()) {
        made.new_index.resize(decoded.points.size(), kDropped);
        for (std::size_t before = 0; before < i; ++before)
          made.new_index[before] = static_cast<std::uint32_t>(before);
      }
      if (finite) {
        ++model.outside;
        made.new_index[i] = kOutside;
      } else if (model.non_finite++ == 0) {
        made.first_bad = i;
      }
      continue;
    }
    if (!made.new_index.empty()) {
      made.new_index[i] = static_cast<std::uint32_t>(kept);
      for (cloud::Property& property : decoded.properties) property.values[kept] = property.values[i];
    }
    decoded.points[kept++] = p;
  }
  decoded.points.resize(kept);
  for (cloud::Property& property : decoded.properties) property.values.resize(kept);
  return made;
}

// A raster with holes is none; what is left of it are two properties, row and column, which a look-up table
// is made of (search/knn.h).
void keep_rows_and_columns(const DecodedFile& decoded, const std::vector<std::uint32_t>& new_index,
                           std::size_t file_points, cloud::Cloud& cloud) {
  constexpr std::uint32_t kWholeInFloat = std::uint32_t{1} << 24;
  const cloud::ScanRaster raster = decoded.raster.value_or(cloud::ScanRaster{decoded.position_columns, 0});
  const auto position = [&](std::size_t i) {
    return decoded.position_of.empty() ? i : std::size_t{decoded.position_of[i]};
  };
  std::size_t last = 0;
  for (std::size_t i = 0; i < file_points; ++i) last = std::max(last, position(i));
  if (raster.columns > kWholeInFloat || last / raster.columns > kWholeInFloat) return;
  for (const cloud::Property& property : cloud.properties)
    if (property.name == "row" || property.name == "column") return;
  cloud::Property row{"row", std::vector<float>(cloud.size())};
  cloud::Property column{"column", std::vector<float>(cloud.size())};
  for (std::size_t i = 0; i < file_points; ++i) {
    const std::size_t point = new_index.empty() ? i : new_index[i];
    if (point >= cloud.size()) continue;  // kDropped, kOutside
    row.values[point] = static_cast<float>(position(i) / raster.columns);
    column.values[point] = static_cast<float>(raster.column(position(i)));
  }
  cloud.properties.push_back(std::move(row));
  cloud.properties.push_back(std::move(column));
}

// Drops the faces, each as a whole, that use a dropped or missing point. Those at the box's border are no
// fault of the file, and not counted.
void clean_faces(DecodedFile& decoded, const std::vector<std::uint32_t>& new_index, std::size_t file_points) {
  auto& triangles = decoded.triangles;
  std::size_t kept = 0;
  for (std::size_t begin = 0; begin < triangles.size();) {
    std::size_t end = begin + 1;
    while (end < triangles.size() && decoded.continues_face[end]) ++end;
    const std::size_t first_kept = kept;
    for (std::size_t t = begin; t < end; ++t) {
      std::array<std::uint32_t, 3> corners = triangles[t];
      bool whole = true, outside = false;
      for (std::uint32_t& corner : corners) {
        if (corner < file_points && !new_index.empty()) {
          corner = new_index[corner];
          outside = outside || corner == kOutside;
        }
        whole = whole && corner < file_points;  // kDropped and kOutside are beyond any count of points
      }
      if (!whole) {
        kept = first_kept;
        if (!outside) ++decoded.dropped_faces;
        break;
      }
      triangles[kept++] = corners;
    }
    begin = end;
  }
  triangles.resize(kept);
  decoded.continues_face.clear();
}

// Of coordinates that the file holds as 32-bit floats far from the origin, what is left of their precision.
void warn_of_float_steps(const std::vector<Vec3>& points_mm, double factor, ReadModel& model) {
  // Rounding by half a step over the distance of two points tilts a surface by 1/32, some 2 degrees.
  constexpr double kStepsPerSpacing = 16.0;
  geometry::Aabb box;
  for (const Vec3& p : points_mm) box.add(p);
  const double farthest = std::max(box.low_mm.cwiseAbs().maxCoeff(), box.high_mm.cwiseAbs().maxCoeff());
  const auto in_file = static_cast<float>(farthest / factor);
  if (!std::isfinite(in_file)) return;
  const double step_mm =
      factor * static_cast<double>(in_file - std::nextafter(in_file, 0.0F));  // below: in_file's own binade
  // Points spread over a surface as large as the box.
  const double spacing_mm = box.extent_mm().norm() / std::sqrt(static_cast<double>(points_mm.size()));
  if (step_mm * kStepsPerSpacing <= spacing_mm) return;
  model.warnings.push_back(fmt::format(
      "The file holds coordinates of up to {:.4g} mm as 32-bit floats, which leave a precision of "
      "{:.3g} mm where points stand some {:.3g} mm apart. Export it with double precision, or "
      "relative to a nearer origin.",
      farthest, step_mm, spacing_mm));
}

std::uint64_t hash_points(const std::vector<Vec3>& points) {
  Hash64 hash;
  for (const Vec3& p : points) {
    hash.real(p.x());
    hash.real(p.y());
    hash.real(p.z());
  }
  return hash.value();
}

struct UnitRow {
  Unit unit;
  double mm;
  std::string_view name;
  std::array<std::string_view, 4> long_names;
};
constexpr std::array<UnitRow, 5> kUnits{{
    {Unit::kMetre, 1000.0, "m", {"metre", "meter", "metres", "meters"}},
    {Unit::kCentimetre, 10.0, "cm", {"centimetre", "centimeter", "centimetres", "centimeters"}},
    {Unit::kMillimetre, 1.0, "mm", {"millimetre", "millimeter", "millimetres", "millimeters"}},
    {Unit::kMicrometre, 1e-3, "um", {"micrometre", "micrometer", "micrometres", "micrometers"}},
    {Unit::kInch, 25.4, "in", {"inch", "inches", "\"", "inch"}},
}};

const UnitRow& row_of(Unit unit) noexcept {
  return kUnits[static_cast<std::size_t>(unit)];
}

// The name without a compression's ending, in lower case, from the last dot on; which ending it was.
std::string extension_of(const std::string& name, std::string& compression_ending) {
  std::string lower = lower_case(name.substr(name.find_last_of('/') + 1));
  constexpr std::size_t kEnding = 3;  // length of ".gz" and of ".xz"
  if (lower.size() > kEnding && (lower.ends_with(".gz") || lower.ends_with(".xz"))) {
    compression_ending = lower.substr(lower.size() - kEnding);
    lower.resize(lower.size() - kEnding);
  }
  const std::size_t dot = lower.find_last_of('.');
  return dot == std::string::npos ? std::string() : lower.substr(dot + 1);
}

Error unknown_type(const std::string& extension, const std::string& known, const std::string& name) {
  const std::string understood = fmt::format("understood are {}, each also with .gz or .xz", known);
  if (extension.empty())
    return Error{"the file's name has no ending that tells its format", understood, name};
  return Error{fmt::format("unknown file type {}", shown("." + extension)), understood, name};
}

}  // namespace

double mm_per(Unit unit) noexcept {
  return row_of(unit).mm;
}
std::string_view unit_name(Unit unit) noexcept {
  return row_of(unit).name;
}

Result<Unit> parse_unit(std::string_view text) {
  const std::string lower = lower_case(trimmed(text));
  for (const UnitRow& row : kUnits) {
    if (lower == row.name ||
        std::find(row.long_names.begin(), row.long_names.end(), lower) != row.long_names.end())
      return row.unit;
  }
  return Error{fmt::format("{} is not a unit", shown(text)), "give m, cm, mm, um or in"};
}

Status check(const ReadOptions& options) {
  if (!(options.scale > 0.0) || !std::isfinite(options.scale))
    return Error{fmt::format("the scale {} is not a positive number", options.scale), "give a scale above 0"};
  for (const double mm : {options.post_mm, options.vertical_mm})
    if (!(mm >= 0.0) || !std::isfinite(mm))
      return Error{fmt::format("{} mm is no distance of posts and no height", mm),
                   "give a positive number of mm"};
  return options.within_mm ? check_box(*options.within_mm) : Status(Done{});
}

Status check_box(const geometry::Aabb& box_mm) {
  if (is_finite(box_mm.low_mm) && is_finite(box_mm.high_mm) &&
      (box_mm.low_mm.array() <= box_mm.high_mm.array()).all())
    return Done{};
  return Error{fmt::format("{} is no box", box_text(box_mm)),
               "give its low corner, then its high one, each as x, y, z in mm"};
}

std::string box_text(const geometry::Aabb& box_mm) {
  // As many digits as place a point of a town to a thousandth of a mm.
  const Vec3 &low = box_mm.low_mm, &high = box_mm.high_mm;
  return fmt::format("({:.12g}, {:.12g}, {:.12g}) to ({:.12g}, {:.12g}, {:.12g}) mm", low.x(), low.y(),
                     low.z(), high.x(), high.y(), high.z());
}

Error nothing_within(const geometry::Aabb& within_mm, const geometry::Aabb& own_mm) {
  return Error{fmt::format("no point is within {}", box_text(within_mm)),
               fmt::format("the points are within {}", box_text(own_mm))};
}

namespace {

/// Refuses options of height grids for another file.
Status check_grid_options(const DecodedFile& decoded, const ReadOptions& options) {
  if (decoded.height_grid) return Done{};
  for (const auto& [given, name, option] :
       {std::tuple(options.post_mm > 0.0, "post_mm", "--post-mm"),
        std::tuple(options.vertical_mm > 0.0, "vertical_mm", "--vertical-mm"),
        std::tuple(options.no_data.has_value(), "no_data", "--no-data")})
    if (given)
      return Error{
          fmt::format("'{}' is of grids of heights, and this file is none ({})", name, decoded.format),
          fmt::format("leave out {} (on the command line {})", name, option)};
  return Done{};
}

/// Unit, scale, cleaning, the cloud, the mesh and the hash: the same for all formats. O(points + faces).
Result<ReadModel> finish_model(DecodedFile&& decoded, const ReadOptions& options, const std::string& name) {
  if (const Status fits = check_grid_options(decoded, options); !fits)
    return Error(fits.error()).in_file(name);
  ReadModel model;
  model.file_points = decoded.points.size();
  if (model.file_points == 0)
    return Error{"the file holds no points", "give a file with at least one point", name};
  model.format = decoded.format;
  model.warnings = std::move(decoded.warnings);
  choose_unit(decoded, options, model);

  const Compacted made = scale_and_compact(decoded, mm_per(model.unit) * options.scale, options, model);
  if (model.non_finite == model.file_points)
    return Error{fmt::format("none of the file's {} points is finite", model.file_points), "check the file",
                 name};
  if (model.non_finite > 0) {
    const std::string found =
        fmt::format("{} of {} points are not finite", model.non_finite, model.file_points);
    if (options.non_finite == cloud::NonFinite::kRefuse)
      return Error{fmt::format("{}, the first is point {}", found, made.first_bad + 1),
                   "drop them with --non-finite drop, or clean the file", name};
    model.warnings.push_back(found + " and were dropped.");
  }
  if (decoded.points.empty()) return nothing_within(*options.within_mm, made.finite_mm).in_file(name);

  cloud::BuildReport report;
  Result<cloud::Cloud> cloud = cloud::build_cloud(decoded.points, cloud::NonFinite::kRefuse, &report);
  if (!cloud) {
    Error error = std::move(cloud).error();
    // The largest float as "no data" is no place: what was warned of is the remedy.
    for (const std::string& warning : model.warnings)
      if (warning.find("--no-data") != std::string::npos) error.remedy = warning;
    return std::move(error).in_file(name);
  }
  model.cloud = std::move(*cloud);
  model.cloud.properties = std::move(decoded.properties);
  if (made.new_index.empty()) model.cloud.raster = decoded.raster;
  if (!model.cloud.raster && (decoded.raster || !decoded.position_of.empty()))
    keep_rows_and_columns(decoded, made.new_index, model.file_points, model.cloud);
  model.max_rounding_mm = report.max_rounding_mm;
  model.content_hash = hash_points(decoded.points);
  if (decoded.single_precision)
    warn_of_float_steps(decoded.points, mm_per(model.unit) * options.scale, model);

  clean_faces(decoded, made.new_index, model.file_points);
  model.dropped_faces = decoded.dropped_faces;
  if (model.dropped_faces > 0)
    model.warnings.push_back(
        fmt::format("{} faces were dropped: they use points that are not there or not finite, or "
                    "have fewer than three corners.",
                    model.dropped_faces));
  if (!decoded.triangles.empty()) {
    model.mesh = std::make_shared<geometry::TriangleMesh>();
    model.mesh->vertices_mm = std::move(decoded.points);
    model.mesh->triangles = std::move(decoded.triangles);
  }
  return model;
}

}  // namespace

void Readers::add(const std::vector<std::string>& extensions, const Reader& reader) {
  for (const std::string& extension : extensions) {
    std::erase_if(entries_, [&](const Entry& entry) { return entry.extension == extension; });
    entries_.push_back({extension, reader});
  }
  std::sort(entries_.begin(), entries_.end(),
            [](const Entry& a, const Entry& b) { return a.extension < b.extension; });
}

std::vector<std::string> Readers::extensions() const {
  std::vector<std::string> all;
  for (const Entry& entry : entries_) all.push_back(entry.extension);
  return all;
}

const Reader* Readers::find(std::string_view extension) const {
  for (const Entry& entry : entries_) {
    if (entry.extension == extension) return &entry.reader;
  }
  return nullptr;
}

Result<ReadModel> Readers::read(const std::string& path, const ReadOptions& options,
                                Progress& progress) const {
  Result<std::unique_ptr<ByteSource>> file = open_file(path);
  if (!file) return std::move(file).error().in_file(path);
  return read(std::move(*file), path, options, progress);
}

Result<ReadModel> Readers::read(std::unique_ptr<ByteSource> source, const std::string& name,
                                const ReadOptions& options, Progress& progress) const {
  std::string ending;
  const std::string extension = extension_of(name, ending);
  const Reader* reader = find(extension);
  if (reader == nullptr) return unknown_type(extension, joined(extensions()), name);
  if (const Status right = check(options); !right) return Error(right.error()).in_file(name);
  if (source->remaining() == std::uint64_t{0}) return Error{"the file is empty", "check the file", name};
  try {
    DecompressionLimits limits;
    limits.max_bytes = options.max_bytes;
    Compression kind = Compression::kNone;
    Result<std::unique_ptr<ByteSource>> bytes = open_maybe_compressed(std::move(source), limits, &kind);
    if (!bytes) return std::move(bytes).error().in_file(name);
    if (!ending.empty() && kind == Compression::kNone)
      return Error{fmt::format("the file is named {} but its content is not compressed", ending),
                   "rename it, or fetch it again", name};
    Result<DecodedFile> decoded = (*reader)(ReaderInput{**bytes, name, options, progress});
    if (!decoded) return std::move(decoded).error().in_file(name);
    Result<ReadModel> model = finish_model(std::move(*decoded), options, name);
    if (!model) return std::move(model).error().in_file(name);
    if (kind != Compression::kNone) model->compression = kind == Compression::kGzip ? "gzip" : "xz";
    return model;
  } catch (const std::bad_alloc&) {
  } catch (const std::length_error&) {
  }
  return Error{"there is not enough memory to read the file", "close other programs or reduce the file",
               name};
}

void add_standard_readers(Readers& readers) {
  readers.add({"ply"}, read_ply);
  readers.add({"xyz", "csv", "txt", "asc"}, read_xyz);
  readers.add({"obj"}, read_obj);
  readers.add({"off"}, read_off);
  readers.add({"pfm"}, read_pfm);
  readers.add({"e57"}, read_e57);
  readers.add({"ptx"}, read_ptx);
  readers.add({"pts"}, read_pts);
  readers.add({"stl"}, read_stl);
  readers.add({"las", "laz"}, read_las_bytes);
}

}  // namespace palpate::io
