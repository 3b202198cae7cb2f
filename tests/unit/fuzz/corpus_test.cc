// Replays what fuzzers start from and what they found: good_* are taken, bad_* are refused, all keep the promises of
// their target.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <string>

#include "tests/fuzz/array_file_target.h"
#include "tests/fuzz/authority_target.h"
#include "tests/fuzz/blocks/blocks_exchange_target.h"
#include "tests/fuzz/colmap/colmap_binary_target.h"
#include "tests/fuzz/colmap/colmap_text_target.h"
#include "tests/fuzz/blocks/gltf_target.h"
#include "tests/fuzz/image_target.h"
#include "tests/fuzz/inspection_target.h"
#include "tests/fuzz/likelihoods_target.h"
#include "tests/fuzz/manifest_target.h"
#include "tests/fuzz/blocks/model_metadata_target.h"
#include "tests/fuzz/blocks/metashape_target.h"
#include "tests/fuzz/npy_target.h"
#include "tests/fuzz/blocks/nvm_target.h"
#include "tests/fuzz/obj_target.h"
#include "tests/fuzz/blocks/pix4d_target.h"
#include "tests/fuzz/blocks/openmvs_target.h"
#include "tests/fuzz/blocks/opensfm_target.h"
#include "tests/fuzz/ply_target.h"
#include "tests/fuzz/blocks/realityscan_target.h"
#include "tests/fuzz/records_target.h"
#include "tests/fuzz/rpc_target.h"
#include "tests/fuzz/s3_answers_target.h"
#include "tests/fuzz/scene_json_target.h"
#include "tests/fuzz/settings_target.h"
#include "tests/fuzz/survey_target.h"
#include "tests/fuzz/task_parameters_target.h"
#include "tests/fuzz/tiff_target.h"
#include "tests/fuzz/tile_reads_target.h"
#include "tests/fuzz/tokens_target.h"

namespace tessera {
namespace {

namespace fs = std::filesystem;

// By the name of the folder below corpus.
const std::map<std::string, bool (*)(const std::string&)> kTargets = {
    {"array_file", RunArrayFileTarget},
    {"authority", RunAuthorityTarget},
    {"blocks_exchange", RunBlocksExchangeTarget},
    {"colmap_binary", RunColmapBinaryTarget},
    {"colmap_text", RunColmapTextTarget},
    {"gltf", RunGltfTarget},
    {"image", RunImageTarget},
    {"inspection", RunInspectionTarget},
    {"likelihoods", RunLikelihoodsTarget},
    {"manifest", RunManifestTarget},
    {"model_metadata", RunModelMetadataTarget},
    {"metashape", RunMetashapeTarget},
    {"npy", RunNpyTarget},
    {"nvm", RunNvmTarget},
    {"obj", RunObjTarget},
    {"pix4d", RunPix4dTarget},
    {"openmvs", RunOpenMvsTarget},
    {"opensfm", RunOpenSfmTarget},
    {"ply", RunPlyTarget},
    {"realityscan", RunRealityscanTarget},
    {"records", RunRecordsTarget},
    {"rpc", RunRpcTarget},
    {"s3_answers", RunS3AnswersTarget},
    {"scene_json", RunSceneJsonTarget},
    {"settings", RunSettingsTarget},
    {"survey", RunSurveyTarget},
    {"task_parameters", RunTaskParametersTarget},
    {"tiff", RunTiffTarget},
    {"tile_reads", RunTileReadsTarget},
    {"tokens", RunTokensTarget},
};

TEST(FuzzCorpus, KeepsItsPromises) {
  const fs::path corpus = TESSERA_SOURCE_DIR "/tests/fuzz/corpus";
  for (const auto& [name, run] : kTargets) {
    int good = 0;
    for (const auto& entry : fs::directory_iterator(corpus / name)) {
      const std::string file = entry.path().filename().string();
      std::cerr << name << "/" << file << "\n";  // the last line, where a target aborts
      std::ifstream content(entry.path(), std::ios::binary);
      const bool taken = run(std::string((std::istreambuf_iterator<char>(content)), {}));
      const bool good_name = file.starts_with("good_");
      EXPECT_TRUE(taken || !good_name) << name << "/" << file;
      EXPECT_FALSE(taken && file.starts_with("bad_")) << name << "/" << file;
      good += good_name;
    }
    EXPECT_GT(good, 0) << name << " starts from nothing that is valid";
  }
}

TEST(FuzzCorpus, HasNoFolderWithoutATarget) {
  for (const auto& entry : fs::directory_iterator(TESSERA_SOURCE_DIR "/tests/fuzz/corpus")) {
    EXPECT_TRUE(kTargets.contains(entry.path().filename().string())) << entry.path();
  }
  for (const auto& entry : fs::recursive_directory_iterator(TESSERA_SOURCE_DIR "/tests/fuzz")) {
    const std::string file = entry.path().filename().string(), end = "_target.h";
    if (!file.ends_with(end)) continue;
    EXPECT_TRUE(kTargets.contains(file.substr(0, file.size() - end.size()))) << file << " is not replayed";
  }
}

}  // namespace
}  // namespace tessera
