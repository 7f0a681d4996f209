// Surfaces in a file: felt from disk as in memory, with little of them in memory, late, damaged.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "tests/files.h"
#include "tests/toolkit/spline_sdf/spline_sdf_scenes.h"
#include "toolkit/spline_sdf/prepared_surface.h"
#include "toolkit/spline_sdf/tile_window.h"

namespace palpate::spline_sdf {

using namespace render;

namespace {

using cloud::Cloud;

std::shared_ptr<const Cloud> torus_cloud(std::size_t points) {
  TorusSpec torus;
  torus.points = points;
  return cloud_of(torus_points(torus)).models.front().cloud;
}

/// A folder of its own, for files that tests share too.
class Folder {
 public:
  Folder() {
    static int made = 0;
    at_ = std::filesystem::path(testing::TempDir()) / fmt::format("palsurf-{}-{}", ::getpid(), made++);
    std::filesystem::create_directories(at_);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  ~Folder() { std::filesystem::remove_all(at_); }
  [[nodiscard]] std::string in(const std::string& name) const { return (at_ / name).string(); }

 private:
  std::filesystem::path at_;
};

struct PreparedFile {
  Folder folder;
  std::string path = folder.in("scan.palsurf");
  std::shared_ptr<const SurfaceFile> file;

  explicit PreparedFile(const std::shared_ptr<const Cloud>& cloud) {
    PrepareReport report;
    const Status made = prepare_surface_file(cloud, {}, {2, nullptr}, report, path);
    EXPECT_TRUE(made) << (made ? "" : made.error().message());
    Result<std::shared_ptr<const SurfaceFile>> opened = SurfaceFile::open(path);
    EXPECT_TRUE(opened) << (opened ? "" : opened.error().message());
    if (opened) file = *opened;
  }
  [[nodiscard]] SceneInput scene() const {
    SceneInput scene;
    ModelInput input;
    input.name = "prepared";
    input.cloud = file->sample();
    input.prepared = file;
    scene.models.push_back(input);
    return scene;
  }
};

std::vector<Vec3> places_near(const BrickGrid& grid, int count) {
  Random random(11);
  const Vec3 extent = grid.box_mm.extent_mm();
  std::vector<Vec3> places;
  for (int i = 0; i < count; ++i)
    places.push_back(grid.in_voxels(
        grid.box_mm.low_mm - 0.1 * extent +
        1.2 * extent.cwiseProduct(Vec3(random.uniform(), random.uniform(), random.uniform()))));
  // Half of them near a brick, where there is something to find.
  const std::vector<BrickGrid::BrickRef> bricks = grid.places();
  for (int i = 0; i < count; ++i) {
    const BrickGrid::BrickRef& b =
        bricks[static_cast<std::size_t>(random.uniform() * static_cast<double>(bricks.size()))];
    const double edge = kBrickCells / grid.per_voxel_of(b.level);
    places.push_back(edge * (Vec3(b.cube[0], b.cube[1], b.cube[2]) +
                             Vec3(random.uniform(), random.uniform(), random.uniform())));
  }
  return places;
}

void expect_same_brick(const BrickGrid& a, const BrickGrid& b, const Vec3& at) {
  const BrickGrid::BrickRef x = a.find(at), y = b.find(at);
  ASSERT_EQ(x.brick == BrickGrid::kNone, y.brick == BrickGrid::kNone) << at.transpose();
  if (x.brick == BrickGrid::kNone) return;
  EXPECT_EQ(x.level, y.level);
  EXPECT_EQ(x.cube, y.cube);
  // A grid may say that smaller bricks follow where the build dropped them all; a tile knows.
  EXPECT_TRUE(y.whole || !x.whole);
  EXPECT_EQ(a.bricks[x.brick].distance, b.bricks[y.brick].distance);
  EXPECT_EQ(a.bricks[x.brick].mask, b.bricks[y.brick].mask);
  EXPECT_EQ(a.bricks[x.brick].piece, b.bricks[y.brick].piece);
}

TEST(SurfaceFile, GivesTheGridBack) {
  for (const std::shared_ptr<const Cloud>& cloud : {torus_cloud(10000), block_cloud()}) {
    const PreparedFile made(cloud);
    const std::shared_ptr<const SplineSdf> own = surface_of(cloud), read = made.file->load(0).value();
    ASSERT_EQ(own->grid.bricks.size(), read->grid.bricks.size());
    EXPECT_EQ(made.file->points(), cloud->size());
    for (const Vec3& at : places_near(own->grid, 4000)) expect_same_brick(own->grid, read->grid, at);
  }
}

TEST(PagedSurface, FindsWhatIsHereAndNotesWhatIsNot) {
  const std::shared_ptr<const Cloud> cloud = block_cloud();
  const PreparedFile made(cloud);
  const std::shared_ptr<const SplineSdf> own = surface_of(cloud);
  const auto paged = PagedSurface::start(made.file, 0, kLeastResidentBytes).value();
  int missed = 0;
  for (const Vec3& at : places_near(own->grid, 2000)) {
    static_cast<void>(paged->grid().find(at));
    if (paged->take_missed()) {
      ++missed;
      ASSERT_TRUE(paged->wait_for_missed(at, nullptr));
    }
    expect_same_brick(own->grid, paged->grid(), at);
    EXPECT_FALSE(paged->take_missed());
  }
  EXPECT_GT(missed, 0);
  EXPECT_EQ(paged->window().damaged(), 0u);
}

std::vector<Vec3> rounds(std::size_t frames) {
  std::vector<Vec3> path = torus_path({}, frames);
  // Lifts off far and comes back elsewhere, so that tiles leave and come.
  for (std::size_t k = 0; k < path.size(); ++k)
    if (k / 700 % 5 == 4)
      path[k] *= 1.0 + 0.8 * std::sin(std::numbers::pi * static_cast<double>(k % 700) / 700.0);
  return path;
}

TEST(PreparedCloudSmooth, IsFeltAsInMemory) {
  for (const std::shared_ptr<const Cloud>& cloud : {torus_cloud(10000), block_cloud()}) {
    const PreparedFile made(cloud);
    SceneInput whole;
    whole.models.emplace_back();
    whole.models.front().cloud = cloud;
    test::Stepped in_memory = prepared(whole, "cloud-smooth", 2),
                  from_disk = prepared(made.scene(), "cloud-smooth", 2);
    const geometry::Aabb box = cloud->box_mm();
    const Vec3 middle = 0.5 * (box.low_mm + box.high_mm);
    in_memory->restart(middle + Vec3(0, 0, 100));
    from_disk->restart(middle + Vec3(0, 0, 100));
    int contacts = 0;
    for (const Vec3& h : rounds(9000)) {
      const Frame a = in_memory->step(middle + h, 0.001), b = from_disk->step(middle + h, 0.001);
      contacts += a.contact;
      ASSERT_EQ(a.contact, b.contact);
      ASSERT_EQ(a.force_n, b.force_n);
      ASSERT_EQ(a.god_object_mm, b.god_object_mm);
    }
    EXPECT_GT(contacts, 1000);
  }
}

TEST(PagedSurface, StaysWithinItsMemory) {
  const PreparedFile made(torus_cloud(700'000));
  const auto paged = PagedSurface::start(made.file, 0, kLeastResidentBytes).value();
  EXPECT_LT(paged->bytes(), kLeastResidentBytes + kLeastResidentBytes / 8);
  const std::shared_ptr<const SplineSdf> whole = made.file->load(0).value();
  ASSERT_GT(whole->grid.bytes(), kLeastResidentBytes);
  // Everywhere, so that every tile comes and the first ones leave.
  const std::vector<BrickGrid::BrickRef> bricks = whole->grid.places();
  const auto place = [&](std::size_t k) {
    const BrickGrid::BrickRef& b = bricks[k];
    return Vec3((kBrickCells / whole->grid.per_voxel_of(b.level)) *
                (Vec3(b.cube[0], b.cube[1], b.cube[2]) + Vec3::Constant(0.5)));
  };
  const auto missed = [&](const Vec3& at) {
    paged->begin_frame(at, nullptr);
    static_cast<void>(paged->grid().find(at));
    return paged->take_missed();
  };
  const std::size_t all = made.file->surfaces().front().keys.size();
  std::size_t most = 0;
  bool left = false;
  for (int round = 0; round < 3; ++round)
    for (std::size_t k = 0; k < bricks.size(); k += 20) {
      const Vec3 at = place(k);
      // Of the second round on, what is missed was here before.
      if (missed(at)) {
        left = left || round > 0;
        ASSERT_TRUE(paged->wait_for_missed(at, nullptr));
      }
      expect_same_brick(whole->grid, paged->grid(), at);
      EXPECT_FALSE(paged->take_missed());
      most = std::max(most, paged->window().resident());
    }
  EXPECT_TRUE(left);
  EXPECT_LT(most, all);
  // What is far leaves before its memory is needed: of a hand that rests a sixteenth becomes free.
  const StoredSurface& stored = made.file->surfaces().front();
  const auto held = [&] {
    std::size_t sum = 0;
    for (std::uint32_t tile = 0; tile < all; ++tile)
      if (paged->window().all_here({&tile, 1})) sum += stored.places[tile].size.bricks;
    return sum;
  };
  const std::size_t capacity = paged->grid().bricks.size() - stored.surface.grid.bricks.size();
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  while (held() > capacity - capacity / 16 && std::chrono::steady_clock::now() < until) {
    paged->begin_frame(place(0), nullptr);
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_LE(held(), capacity - capacity / 16);
}

test::Stepped paced(const PreparedFile& made) {
  test::Stepped renderer = renderer_of("cloud-smooth:resident_mb=16");
  PrepareContext context{2, nullptr};
  context.paced = true;
  EXPECT_TRUE(renderer->prepare(made.scene(), context));
  return renderer;
}

/// In a paced session nothing waits: what is late is felt coarsely, and no force leaps.
TEST(PreparedCloudSmooth, LateTilesAreFeltCoarselyAndWithoutAStep) {
  const PreparedFile made(torus_cloud(60'000));
  test::Stepped renderer = paced(made);
  const Truth truth = torus_truth({});
  const std::vector<Vec3> path = torus_path({}, 4000);
  renderer->restart(path.front());
  Vec3 last = Vec3::Zero(), last_h = path.front();
  double largest_excess = 0.0;
  int lost = 0;
  for (const Vec3& h : path) {
    const Frame frame = renderer->step(h, 0.001);
    Vec3 closest;
    lost += truth(h, closest) < -0.5 && !frame.contact;
    largest_excess =
        std::max(largest_excess, (frame.force_n - last).norm() - kTestStiffness * (h - last_h).norm());
    last = frame.force_n;
    last_h = h;
  }
  // A coarser surface is right within its error, and a step between the two is spread over twenty frames.
  EXPECT_LT(largest_excess, 0.05);
  EXPECT_LT(lost, 20);
}

/// Nothing can be here of a place that the loader did not know: that is no lateness.
TEST(PreparedCloudSmooth, AStartIsCoarseAndNotLate) {
  const PreparedFile made(torus_cloud(60'000));
  test::Stepped renderer = paced(made);
  const Vec3 start = torus_path({}, 4000).front();
  renderer->restart(start);
  static_cast<void>(renderer->step(start, 0.001));
  EXPECT_EQ(renderer->counters().late_frames, 0u);
}

/// At hundreds of metres a second no loader keeps up.
TEST(PreparedCloudSmooth, EveryFrameIsAnsweredWhileTilesAreLate) {
  const PreparedFile made(torus_cloud(60'000));
  test::Stepped renderer = paced(made);
  const std::vector<Vec3> path = torus_path({}, 8000);
  renderer->restart(path.front());
  int contacts = 0;
  for (std::size_t k = 0; k < path.size(); k += 20) {
    const Frame frame = renderer->step(path[k], 0.001);
    contacts += frame.contact;
    EXPECT_LT(frame.force_n.norm(), 3.0 * kTestStiffness);
  }
  EXPECT_GT(contacts, 200);
  EXPECT_GT(renderer->counters().coarse_frames, 0u);
}

/// A sheet with waves: the side of an open one is known only from where the hand comes.
TEST(PreparedCloudSmooth, AnOpenSheetIsNotLostWhileTilesAreLate) {
  Random random(9);
  std::vector<Vec3> points;
  for (int i = 0; i < 60'000; ++i) {
    const double x = 40.0 * random.uniform(), y = 40.0 * random.uniform();
    points.emplace_back(x, y, 0.8 * std::sin(0.5 * x) * std::sin(0.4 * y));
  }
  const PreparedFile made(cloud_of(points).models.front().cloud);
  test::Stepped renderer = paced(made);
  const auto height = [](double x, double y) { return 0.8 * std::sin(0.5 * x) * std::sin(0.4 * y); };
  renderer->restart({5.0, 20.0, 3.0});
  int lost = 0, contacts = 0;
  for (int k = 0; k < 6000; ++k) {
    const double x = 5.0 + 0.005 * k, depth = 0.6 * std::sin(0.004 * k) - 0.1;
    const Vec3 h(x, 20.0, height(x, 20.0) - depth);
    const Frame frame = renderer->step(h, 0.001);
    lost += depth > 0.3 && !frame.contact;
    contacts += frame.contact;
    // As fast as a disk that is asked by others too.
    if (k % 50 == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_GT(contacts, 2000);
  EXPECT_LT(lost, 60);
}

/// What left the window comes back to a hand that rests.
TEST(PagedSurface, AHandThatRestsGetsTheFinestSurfaceBack) {
  const PreparedFile made(torus_cloud(60'000));
  test::Stepped renderer = paced(made);
  const std::vector<Vec3> path = torus_path({}, 900);
  renderer->restart(path.front());
  for (const Vec3& h : path) static_cast<void>(renderer->step(h, 0.001));
  const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(10);
  std::uint64_t coarse = 0, now = 1;
  while (coarse != now && std::chrono::steady_clock::now() < until) {
    coarse = renderer->counters().coarse_frames;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    for (int k = 0; k < 20; ++k) static_cast<void>(renderer->step(path.back(), 0.001));
    now = renderer->counters().coarse_frames;
  }
  EXPECT_EQ(coarse, now);
}

/// A replay's jump may need more tiles than there is memory for: it goes on, if need be coarsely.
TEST(PagedSurface, AJumpAcrossTheWholeDoesNotHang) {
  const PreparedFile made(torus_cloud(60'000));
  test::Stepped renderer = prepared(made.scene(), "cloud-smooth:resident_mb=16", 2);
  renderer->restart({-30.0, 0.0, 0.0});
  for (int k = 0; k < 50; ++k)
    EXPECT_TRUE(renderer->step({k % 2 == 0 ? 30.0 : -30.0, 0.1 * k, 0.0}, 0.001).force_n.allFinite());
}

TEST(TileWindow, AFullRingRefusesAndNothingIsLostOrReordered) {
  SpscRing<std::uint64_t, 8> ring;
  std::uint64_t got = 0;
  EXPECT_FALSE(ring.pop(got));
  for (std::uint64_t i = 0; i < 8; ++i) EXPECT_TRUE(ring.push(i));
  EXPECT_FALSE(ring.push(8));
  ASSERT_TRUE(ring.pop(got));
  EXPECT_EQ(got, 0u);
  EXPECT_TRUE(ring.push(8));

  constexpr std::uint64_t kValues = 50'000;
  std::uint64_t wrong = 0;
  std::thread reader([&] {
    for (std::uint64_t next = 1; next < kValues;) {
      std::uint64_t value = 0;
      if (!ring.pop(value)) {
        std::this_thread::yield();
        continue;
      }
      wrong += value != next++;
    }
  });
  for (std::uint64_t i = 9; i < kValues;) {
    if (ring.push(i))
      ++i;
    else
      std::this_thread::yield();
  }
  reader.join();
  EXPECT_EQ(wrong, 0u);
}

TEST(TileWindow, ATileThatIsRefusedAndToldToLeaveIsAnsweredForBoth) {
  TileWindow window({{0, 3}, {1, 3}}, 1, 4);
  ASSERT_TRUE(window.news.push({0, 1}));
  ASSERT_TRUE(window.news.push({1, 2}));
  ASSERT_TRUE(window.news.push({1, TileNews::kForget}));
  BrickGrid grid;
  window.take_news(grid, nullptr);
  TileForgotten answer;
  ASSERT_TRUE(window.forgotten.pop(answer));
  EXPECT_EQ(answer.why, TileForgotten::Why::kRefused);
  ASSERT_TRUE(window.forgotten.pop(answer));
  EXPECT_EQ(answer.why, TileForgotten::Why::kGone);
  EXPECT_EQ(window.resident(), 1u);
}

TEST(SurfaceFile, DamageIsNamedAndNothingCrashes) {
  const PreparedFile made(torus_cloud(3000));
  const std::string whole = file_text(made.path), other = made.folder.in("damaged.palsurf");
  std::size_t opened = 0, refused = 0;
  Random random(3);
  for (int k = 0; k < 400; ++k) {
    std::string bytes = whole;
    const auto at = static_cast<std::size_t>(random.uniform() * static_cast<double>(bytes.size()));
    if (k % 4 == 0)
      bytes.resize(at);
    else
      bytes[at] = static_cast<char>(bytes[at] ^ (1 << (k % 8)));
    write_text(other, bytes);
    Result<std::shared_ptr<const SurfaceFile>> file = SurfaceFile::open(other);
    if (!file) {
      ++refused;
      EXPECT_NE(file.error().message().find("damaged.palsurf"), std::string::npos);
      EXPECT_FALSE(file.error().remedy.empty());
      continue;
    }
    ++opened;
    const auto read = (*file)->load(0);
    const auto coarse = (*file)->load((*file)->surfaces().size() - 1);
    EXPECT_TRUE(!read || !coarse || at < 16) << "byte " << at << " is covered by no checksum";
  }
  EXPECT_GT(opened, 10u);
  EXPECT_GT(refused, 10u);
}

TEST(PagedSurface, ADamagedTileIsAbsentAndNamed) {
  const std::shared_ptr<const Cloud> cloud = torus_cloud(40000);
  const PreparedFile made(cloud);
  const StoredSurface& stored = made.file->surfaces().front();
  std::string bytes = file_text(made.path);
  bytes[stored.places[1].offset + 500] ^= 1;
  const std::string other = made.folder.in("damaged.palsurf");
  write_text(other, bytes);
  const auto paged = PagedSurface::start(SurfaceFile::open(other).value(), 0, kLeastResidentBytes).value();
  const std::shared_ptr<const SplineSdf> whole = made.file->load(0).value();
  std::size_t absent = 0, here = 0;
  for (const BrickGrid::BrickRef& b : whole->grid.places()) {
    const double edge = kBrickCells / whole->grid.per_voxel_of(b.level);
    const Vec3 at = edge * (Vec3(b.cube[0], b.cube[1], b.cube[2]) + Vec3::Constant(0.5));
    BrickGrid::BrickRef found = paged->grid().find(at);
    if (paged->take_missed()) {
      ASSERT_TRUE(paged->wait_for_missed(at, nullptr));
      found = paged->grid().find(at);
    }
    found.brick == BrickGrid::kNone ? ++absent : ++here;
  }
  EXPECT_EQ(absent, stored.places[1].size.bricks);
  EXPECT_GT(here, absent);
  EXPECT_EQ(paged->window().damaged(), 1u);
  EXPECT_EQ(paged->window().first_damaged(), 1u);
}

TEST(PreparedCloudSmooth, RefusesWhatTheFileCannotGive) {
  const PreparedFile made(torus_cloud(3000));
  const auto refused = [&](const std::string& spec, const std::string& word) {
    const Result<PrepareReport> report = prepare_report(made.scene(), spec);
    ASSERT_FALSE(report) << spec;
    EXPECT_NE(report.error().message().find(word), std::string::npos) << report.error().message();
  };
  refused("cloud-smooth:detail=3", "detail");
  refused("cloud-smooth:level=9", "level 9");
  EXPECT_TRUE(prepare_report(made.scene(), "cloud-smooth:level=1"));
}

}  // namespace
}  // namespace palpate::spline_sdf
