// A part of a model's file: the box's frame, what follows its points, and files of cells.
#include <gtest/gtest.h>

#include <palpate/scene.h>
#include "tests/toolkit/messages.h"
#include "tests/toolkit/prepared/prepared_points.h"

namespace palpate::scene {
namespace {

class WithinScene : public prepared::test::Prepared {
 protected:
  Result<LoadedScene> loaded(const std::string& text, const LoadOptions& options = {}) const {
    PALPATE_ASSIGN(const SceneFile scene, parse_scene(text, in("scene.toml")));
    io::Readers readers;
    io::add_standard_readers(readers);
    return load(scene, readers, options, no_progress());
  }
};

TEST_F(WithinScene, TheBoxIsInTheModelsFrameAfterUnitAndScaleAndBeforeThePose) {
  write("columns.csv", "x,y,z,k\n0,0,0,1\n1,0,0,2\n2,0,0,3\n3,0,0,4\n");
  const auto got =
      test::value_of(loaded("[[model]]\ncloud = \"columns.csv\"\nunit = \"cm\"\nscale = 2\n"
                            "position_mm = [1000, 0, 0]\nwithin_mm = [[20, -1, -1], [40, 1, 1]]\n"
                            "[model.surface]\nstiffness_n_per_mm = { column = \"k\" }\n"));
  const render::ModelInput& model = got.input.models[0];
  ASSERT_EQ(model.cloud->size(), 2u);
  EXPECT_EQ(model.cloud->point_mm(0), Vec3(20, 0, 0));
  EXPECT_EQ(model.surface.per_point->stiffness_n_per_mm, (std::vector<float>{2, 3}));
  EXPECT_EQ(model.world_from_model.translation_mm.x(), 1000.0);
  EXPECT_EQ(got.provenance[0].file_points, 4u);
  EXPECT_EQ(got.provenance[0].outside, 2u);
  EXPECT_TRUE(test::contains(got.provenance[0].source,
                             "columns.csv (2 of 4 points, within (20, -1, -1) to (40, 1, 1) mm)"));
}

TEST_F(WithinScene, OfViewsItIsOfTheMergedPoints) {
  write("a.csv", "x,y,z,k\n0,0,0,1\n5,0,0,2\n");
  write("b.csv", "x,y,z,k\n0,0,0,3\n0,5,0,4\n");
  const std::string model =
      "[[model]]\ncloud = \"a.csv\"\nunit = \"mm\"\n[[model.view]]\ncloud = \"b.csv\"\n"
      "position_mm = [5, 0, 0]\n";
  LoadOptions options;
  options.within_mm = geometry::Aabb{{4, -1, -1}, {6, 6, 1}};
  const auto got = test::value_of(loaded(model, options));
  ASSERT_EQ(got.input.models[0].cloud->size(), 3u);
  EXPECT_EQ(got.input.models[0].cloud->point_mm(2), Vec3(5, 5, 0));
  EXPECT_EQ(got.input.models[0].cloud->properties[0].values, (std::vector<float>{2, 3, 4}));
  EXPECT_EQ(got.provenance[0].outside, 1u);
  options.within_mm = geometry::Aabb{{8, 8, 8}, {9, 9, 9}};
  EXPECT_TRUE(test::refused(loaded(model, options), "the points are within (0, 0, 0) to (5, 5, 0) mm"));
}

TEST_F(WithinScene, FacesAreCutBeforePointsAreTakenInThem) {
  write("a.off", "OFF\n5 2 0\n0 0 0\n9 0 0\n0 9 0\n50 0 0\n50 9 0\n3 0 1 2\n3 1 3 4\n");
  const auto got =
      test::value_of(loaded("[[model]]\ncloud = \"a.off\"\nunit = \"mm\"\nsample = \"random:points=500\"\n"
                            "within_mm = [[0, 0, 0], [9, 9, 0]]\n"));
  EXPECT_LT(got.input.models[0].cloud->box_mm().high_mm.x(), 9.001);
  EXPECT_EQ(got.sampled_mesh[0]->triangles.size(), 1u);
}

TEST_F(WithinScene, OfCellsItIsWhatBruteForceKeeps) {
  const auto sheet = prepared::test::Sheet::make(150, 0.3, {5.0, 6.0, 7.0}, 13);
  prepared::PrepareCellsOptions made;
  made.quantum_mm = 1e-4;
  (void)prepare(sheet.points, made, "hall.palcells");
  const std::string model = "[[model]]\ncloud = \"hall.palcells\"\n";
  const auto whole = test::value_of(loaded(model));
  const auto part = test::value_of(loaded(model + "within_mm = [[10, 10, 0], [17, 21, 30]]\n"));
  // Away from the box's faces: each cloud rounds its points about its own middle.
  const geometry::Aabb sure = geometry::Aabb{{10, 10, 0}, {17, 21, 30}}.grown(-1e-5);
  const geometry::Aabb perhaps = geometry::Aabb{{10, 10, 0}, {17, 21, 30}}.grown(1e-5);
  std::size_t least = 0, most = 0;
  const cloud::Cloud& all = *whole.input.models[0].cloud;
  for (std::size_t i = 0; i < all.size(); ++i) {
    least += sure.contains(all.point_mm(i)) ? 1u : 0u;
    most += perhaps.contains(all.point_mm(i)) ? 1u : 0u;
  }
  const std::size_t kept = part.input.models[0].cloud->size();
  EXPECT_GT(least, 100u);
  EXPECT_GE(kept, least);
  EXPECT_LE(kept, most);
  EXPECT_EQ(part.provenance[0].file_points, sheet.points.size());
  EXPECT_EQ(part.provenance[0].outside, sheet.points.size() - kept);
  // The command line's box replaces the scene's, and is checked.
  LoadOptions options;
  options.within_mm = geometry::Aabb{{-2, -2, -2}, {-1, -1, -1}};
  EXPECT_TRUE(test::refused(loaded(model + "within_mm = [[10, 10, 0], [17, 21, 30]]\n", options),
                            "hall.palcells: no point is within (-2, -2, -2)"));
  options.within_mm = geometry::Aabb{{2, 0, 0}, {1, 1, 1}};
  EXPECT_TRUE(test::refused(loaded(model, options), "is no box"));
}

}  // namespace
}  // namespace palpate::scene
