#include "tests/toolkit/laz/las_files.h"

#include <gtest/gtest.h>

#include <bit>
#include <random>

#include <palpate/progress.h>
#include "tests/toolkit/messages.h"
#include "toolkit/core/bytes.h"
#include "toolkit/core/files.h"
#include "toolkit/io/las_header.h"
#include "toolkit/io/read_las.h"

namespace palpate::test {
namespace {

constexpr std::size_t kPointBytes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
constexpr std::size_t kTestHeaderBytes[] = {227, 227, 227, 235, 375};

void append(std::vector<std::byte>& to, std::span<const std::byte> bytes) {
  to.insert(to.end(), bytes.begin(), bytes.end());
}

}  // namespace

std::size_t las_point_bytes(std::uint8_t format) noexcept {
  return kPointBytes[format];
}

std::vector<std::byte> scanned_points(std::uint8_t format, std::size_t extra_bytes, std::size_t count,
                                      std::uint64_t seed) {
  std::mt19937_64 random(seed);
  const auto below = [&](std::uint64_t n) { return random() % n; };
  const bool layered = format >= 6;
  const std::size_t bytes = las_point_bytes(format) + extra_bytes;
  std::vector<std::byte> points(count * bytes);
  std::uint64_t times[4];
  for (std::size_t line = 0; line < 4; ++line)
    times[line] = std::bit_cast<std::uint64_t>(1000.0 + 7e5 * static_cast<double>(line));
  std::uint64_t line = 0, returns = 1, at_return = 1, waveform = 60, waveform_bytes = 128;
  std::int32_t x = 1000, y = -2000, z = 300;
  std::uint64_t intensity = 100, source = 3, angle = 0, user_data = 0, colour = 0x1020, channel = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (++at_return > returns) {
      at_return = 1;
      returns = below(4) != 0 ? 1 : 1 + below(layered ? 15 : 7);
      times[line] += below(40) == 0 ? below(std::uint64_t{1} << 31) : 50000 + below(3);
      if (below(30) == 0) line = below(4);
      if (below(200) == 0) times[line] += std::uint64_t{1} << 44;
      if (below(3) == 0) channel = below(4);
      x += static_cast<std::int32_t>(below(21)) - 5;
      y += static_cast<std::int32_t>(below(2000)) - 1000;
    }
    if (below(100) == 0) x = static_cast<std::int32_t>(random());
    z += static_cast<std::int32_t>(below(200)) - 100;
    if (below(5) == 0) intensity = below(65536);
    if (below(50) == 0) source = below(65536);
    if (below(9) == 0) angle = below(65536);
    if (below(20) == 0) user_data = below(256);
    const std::uint64_t number = below(50) == 0 ? below(8) : at_return;
    ByteWriter out(std::span<std::byte>(points).subspan(i * bytes, bytes));
    out.i32(x);
    out.i32(y);
    out.i32(z);
    out.u16(static_cast<std::uint16_t>(intensity));
    const std::uint64_t direction = below(7) == 0 ? 1 : 0;
    if (layered) {
      out.u8(static_cast<std::uint8_t>(number | returns << 4));
      out.u8(static_cast<std::uint8_t>(below(10) == 0 ? below(16) : 0) |
             static_cast<std::uint8_t>(channel << 4 | direction << 6));
      out.u8(static_cast<std::uint8_t>(below(3) == 0 ? below(200) : 2));
      out.u8(static_cast<std::uint8_t>(user_data));
      out.u16(static_cast<std::uint16_t>(angle));
      out.u16(static_cast<std::uint16_t>(source));
      out.u64(times[line]);
    } else {
      out.u8(static_cast<std::uint8_t>((number & 7u) | returns << 3 | direction << 6));
      out.u8(static_cast<std::uint8_t>(below(3) == 0 ? below(200) : 2));
      out.u8(static_cast<std::uint8_t>(angle));
      out.u8(static_cast<std::uint8_t>(user_data));
      out.u16(static_cast<std::uint16_t>(source));
      if (format == 1 || format >= 3) out.u64(times[line]);
    }
    if (format == 2 || format == 3 || format == 5 || format == 7 || format == 8 || format == 10) {
      colour += below(400) - 200;
      const bool grey = below(4) == 0;
      for (int channels = 0; channels < 3; ++channels)
        out.u16(static_cast<std::uint16_t>(colour + (grey ? 0 : below(300))));
    }
    if (format == 8 || format == 10) out.u16(static_cast<std::uint16_t>(colour + below(600)));
    if (format == 4 || format == 5 || format >= 9) {
      const std::uint64_t how = below(5);
      if (how == 0) waveform += waveform_bytes;
      if (how == 1) waveform += below(100000);
      if (how == 2) waveform += std::uint64_t{1} << 36;
      if (below(4) == 0) waveform_bytes = 64 + below(200);
      out.u8(static_cast<std::uint8_t>(below(3)));
      out.u64(waveform);
      out.u32(static_cast<std::uint32_t>(waveform_bytes));
      for (int floats = 0; floats < 4; ++floats) out.single(static_cast<float>(below(1000)) * 0.25F);
    }
    while (out.size() < bytes) out.u8(static_cast<std::uint8_t>(below(2) == 0 ? 7 : below(256)));
  }
  return points;
}

void add_record(LasFile& file, const std::string& user, std::uint16_t number,
                std::span<const std::byte> content) {
  std::vector<std::byte> head(54);
  ByteWriter out(head);
  out.u16(0);
  std::string name = user;
  name.resize(16, '\0');
  out.raw(std::as_bytes(std::span(name)));
  out.u16(number);
  out.u16(static_cast<std::uint16_t>(content.size()));
  append(file.records, head);
  append(file.records, content);
  ++file.record_count;
}

std::vector<std::byte> las_bytes(const LasFile& file) {
  const std::size_t point_bytes = las_point_bytes(file.format);
  const std::size_t count = file.points.size() / point_bytes;
  const std::size_t header_bytes = kTestHeaderBytes[file.minor];
  std::vector<std::byte> bytes(header_bytes);
  ByteWriter out(bytes);
  out.raw(std::as_bytes(std::span("LASF", 4)));
  for (int i = 0; i < 20; ++i) out.u8(0);
  out.u8(1);
  out.u8(file.minor);
  for (int i = 0; i < 68; ++i) out.u8(0);
  out.u16(static_cast<std::uint16_t>(header_bytes));
  out.u32(static_cast<std::uint32_t>(header_bytes + file.records.size()));
  out.u32(file.record_count);
  out.u8(file.format);
  out.u16(static_cast<std::uint16_t>(point_bytes));
  out.u32(file.format >= 6 ? 0 : static_cast<std::uint32_t>(count));
  for (int i = 0; i < 5; ++i) out.u32(0);
  for (int i = 0; i < 3; ++i) out.real(0.01);
  for (const double offset : {100.0, 200.0, 300.0}) out.real(offset);
  for (int i = 0; i < 3; ++i) {
    out.real(1e6);
    out.real(-1e6);
  }
  if (file.minor >= 3) out.u64(0);
  if (file.minor >= 4) {
    out.u64(0);
    out.u32(0);
    out.u64(count);
  }
  append(bytes, file.records);
  append(bytes, file.points);
  return bytes;
}

std::vector<std::byte> laz_bytes(const std::string& name) {
  const std::string text =
      value_of(read_file(std::string(PALPATE_CORPUS) + "/laz/" + name, std::uint64_t{1} << 20));
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

std::vector<std::byte> laz_points(std::uint8_t format, std::size_t extra_bytes) {
  return scanned_points(format, extra_bytes, kLazPoints, 7u + format);
}

Result<std::vector<std::byte>> raw_points(const io::RandomAccess& file, int threads) {
  PALPATE_ASSIGN(const io::LasHeader header, io::read_las_header(file));
  PALPATE_ASSIGN(io::LasPoints points, io::LasPoints::open(file, header, threads));
  std::vector<std::byte> all;
  while (true) {
    PALPATE_ASSIGN(const std::span<const std::byte> piece, points.next());
    if (piece.empty()) return all;
    append(all, piece);
  }
}

void expect_harmless(std::span<const std::byte> bytes) {
  const io::MemoryAccess access(bytes);
  io::ReadOptions options;
  options.max_bytes = std::uint64_t{1} << 24;
  const Result<io::DecodedFile> model = io::read_las(access, "a.laz", options, no_progress());
  if (!model) {
    EXPECT_FALSE(model.error().remedy.empty()) << model.error().message();
    return;
  }
  const auto header = test::value_of(io::read_las_header(access));
  EXPECT_EQ(model->points.size(), header.points);
}

}  // namespace palpate::test
