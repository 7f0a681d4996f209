#include <palpate/read_model.h>

#include <fmt/format.h>
#include <pcl/PCLPointCloud2.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <span>
#include <sstream>

#include <palpate/result.h>
#include "toolkit/io/decoding.h"
#include "toolkit/io/pcd_header.h"

namespace palpate::pcd {
namespace {

// PCL's messages go to the terminal unless its global level forbids it.
class Silence {
 public:
  Silence() : before_(pcl::console::getVerbosityLevel()) {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
  }
  ~Silence() { pcl::console::setVerbosityLevel(before_); }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  pcl::console::VERBOSITY_LEVEL before_;
};

template <class T>
double load_as(const std::uint8_t* at) noexcept {
  T value;
  std::memcpy(&value, at, sizeof value);
  return static_cast<double>(value);
}

double load(std::uint8_t datatype, const std::uint8_t* at) noexcept {
  using pcl::PCLPointField;
  switch (datatype) {
    case PCLPointField::INT8:
      return load_as<std::int8_t>(at);
    case PCLPointField::UINT8:
      return load_as<std::uint8_t>(at);
    case PCLPointField::INT16:
      return load_as<std::int16_t>(at);
    case PCLPointField::UINT16:
      return load_as<std::uint16_t>(at);
    case PCLPointField::INT32:
      return load_as<std::int32_t>(at);
    case PCLPointField::UINT32:
      return load_as<std::uint32_t>(at);
    case PCLPointField::INT64:
      return load_as<std::int64_t>(at);
    case PCLPointField::UINT64:
      return load_as<std::uint64_t>(at);
    case PCLPointField::FLOAT32:
      return load_as<float>(at);
    default:
      return load_as<double>(at);
  }
}

Error refused(std::string why) {
  return Error{"PCL cannot read the file: " + std::move(why),
               "check it with another program, or fetch it again"};
}

// PCL reads the canonical header and the body from memory. It may throw: the caller catches.
Result<pcl::PCLPointCloud2> through_pcl(std::span<const std::byte> file, const io::PcdHeader& header) {
  pcl::PCLPointCloud2 cloud;
  pcl::PCDReader reader;
  Eigen::Vector4f origin;
  Eigen::Quaternionf orientation;
  int version = 0;
  int type = 0;
  unsigned int body_at = 0;
  std::istringstream text(header.canonical);
  if (reader.readHeader(text, cloud, origin, orientation, version, type, body_at) != 0)
    return refused("its header");
  const std::span<const std::byte> body = file.subspan(header.body_at);
  const auto* bytes = reinterpret_cast<const unsigned char*>(body.data());
  int code = 0;
  if (header.data == io::PcdData::kAscii) {
    std::string text_rows(reinterpret_cast<const char*>(body.data()), body.size());
    if (header.cr_ends_lines) std::replace(text_rows.begin(), text_rows.end(), '\r', '\n');
    std::istringstream rows(std::move(text_rows));
    code = reader.readBodyASCII(rows, cloud, version);
  } else {
    code = reader.readBodyBinary(bytes, cloud, version, header.data == io::PcdData::kCompressed, 0);
  }
  if (code != 0) return refused("its data is damaged");
  return cloud;
}

// Colours are packed into the bits of one float or integer: no number per point.
bool is_colour(const std::string& name) {
  return name == "rgb" || name == "rgba";
}

Result<io::DecodedFile> to_points(const pcl::PCLPointCloud2& cloud, const io::PcdHeader& header) {
  const auto count = static_cast<std::size_t>(header.points());
  if (std::size_t{cloud.width} * cloud.height != count || cloud.data.size() < count * cloud.point_step)
    return refused("it gave another number of points than the header");
  io::DecodedFile decoded;
  struct Column {
    std::uint8_t type;
    std::size_t offset;
    std::size_t property;
  };
  const pcl::PCLPointField* axes[3] = {nullptr, nullptr, nullptr};
  std::vector<Column> columns;
  for (const pcl::PCLPointField& field : cloud.fields) {
    if (std::size_t{field.offset} + static_cast<std::size_t>(pcl::getFieldSize(field.datatype)) >
        cloud.point_step)
      return refused("a field lies outside its point");
    if (field.name.size() == 1 && field.name[0] >= 'x' && field.name[0] <= 'z') {
      axes[field.name[0] - 'x'] = &field;
    } else if (field.count == 1 && field.name != "_" && !is_colour(field.name)) {
      columns.push_back({field.datatype, field.offset, decoded.properties.size()});
      decoded.properties.push_back({field.name, std::vector<float>(count)});
    }
  }
  if (axes[0] == nullptr || axes[1] == nullptr || axes[2] == nullptr) return refused("x, y or z is missing");
  decoded.single_precision = true;
  for (const pcl::PCLPointField* axis : axes)
    decoded.single_precision = decoded.single_precision && axis->datatype == pcl::PCLPointField::FLOAT32;
  decoded.points.resize(count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* const row = cloud.data.data() + i * cloud.point_step;
    for (int axis = 0; axis < 3; ++axis)
      decoded.points[i][axis] = load(axes[axis]->datatype, row + axes[axis]->offset);
    for (const Column& column : columns)
      decoded.properties[column.property].values[i] = io::to_float(load(column.type, row + column.offset));
  }
  if (header.height > 1) decoded.raster = cloud::ScanRaster{header.width, header.height};
  return decoded;
}

Result<io::DecodedFile> read_pcd(const io::ReaderInput& input) {
  input.progress.report("reading", 0.0);
  PALPATE_ASSIGN(const std::vector<std::byte> file, io::read_all(input.bytes, input.options.max_bytes));
  PALPATE_ASSIGN(const io::PcdHeader header, io::check_pcd(file, input.options));
  if (input.progress.cancelled()) return Error{"reading was stopped"};
  const Silence silence;
  try {
    PALPATE_ASSIGN(const pcl::PCLPointCloud2 cloud, through_pcl(file, header));
    Result<io::DecodedFile> decoded = to_points(cloud, header);
    if (!decoded) return decoded;
    decoded->format = header.data == io::PcdData::kAscii    ? "PCD, ASCII"
                      : header.data == io::PcdData::kBinary ? "PCD, binary"
                                                            : "PCD, binary_compressed";
    decoded->conventional_unit = io::Unit::kMetre;
    return decoded;
  } catch (const std::bad_alloc&) {
    return Error{"there is not enough memory to read the file", "close other programs or reduce the file"};
  } catch (const std::exception& thrown) {
    return refused(shown(thrown.what()));
  } catch (...) {
    return refused("for a reason it does not give");
  }
}

}  // namespace

void add_pcd_reader(io::Readers& readers) {
  readers.add({kPcdExtension}, read_pcd);
}

}  // namespace palpate::pcd
