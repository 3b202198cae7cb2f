// Calls that describe jobs to pages: tiles, views, files, settings, quotes.
#include "common/exporting/export_format.h"
#include "common/rpc/status_conversion.h"
#include "server/grpc/conversion.h"
#include "server/grpc/request_bounds.h"
#include "server/grpc/services.h"

namespace tessera {
namespace {

// Converts the items of a page until it reaches its size in bytes, and sets the token of the next page: `next` (-1:
// none), or the place of the first item that did not fit.
template <class Item, class Add, class Place, class Response>
void FillPage(const std::vector<Item>& items, const Add& add, const Place& place, int next, Response* response) {
  size_t bytes = 0;
  for (const Item& item : items) {
    if (bytes > kPageBytes) {
      response->set_next_page_token(std::to_string(place(item)));
      return;
    }
    bytes += add(item);
  }
  if (next >= 0) response->set_next_page_token(std::to_string(next));
}

}  // namespace

grpc::Status JobsService::ListTiles(grpc::ServerContext*, const v1::ListTilesRequest* request,
                                    v1::ListTilesResponse* response) {
  const auto first = ParsePageToken(request->page_token(), 0);
  if (!first.ok()) return ToGrpc(first.status());
  const auto page = tiles_.ListTiles(request->parent(), *first, PageSize(request->page_size(), kMaxPage));
  if (!page.ok()) return ToGrpc(page.status());
  const auto add = [&](const ListedTile& tile) {
    v1::Tile& added = *response->add_tiles();
    ToProto(tile, &added);
    return added.ByteSizeLong();
  };
  FillPage(
      page->tiles, add, [](const ListedTile& tile) { return tile.status.tile; }, page->next, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::ListViews(grpc::ServerContext*, const v1::ListViewsRequest* request,
                                    v1::ListViewsResponse* response) {
  const auto first = ParsePageToken(request->page_token(), 0);
  if (!first.ok()) return ToGrpc(first.status());
  const auto page = tiles_.ListViews(request->parent(), *first, PageSize(request->page_size(), kMaxPage));
  if (!page.ok()) return ToGrpc(page.status());
  const auto add = [&](const ListedView& view) {
    v1::View& added = *response->add_views();
    ToProto(view, &added);
    return added.ByteSizeLong();
  };
  const auto place = [&](const ListedView& view) { return *first + static_cast<int>(&view - page->views.data()); };
  FillPage(page->views, add, place, page->next, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::LocatePoint(grpc::ServerContext*, const v1::LocatePointRequest* request,
                                      v1::LocatePointResponse* response) {
  const auto found = tiles_.LocatePoint(request->name(), {request->x_m(), request->y_m(), request->z_m()});
  if (!found.ok()) return ToGrpc(found.status());
  ToProto(*found, response);
  return grpc::Status::OK;
}

grpc::Status JobsService::ListArtifacts(grpc::ServerContext*, const v1::ListArtifactsRequest* request,
                                        v1::ListArtifactsResponse* response) {
  const auto first = ParsePageToken(request->page_token(), 0);
  if (!first.ok()) return ToGrpc(first.status());
  const auto page =
      jobs_.ListArtifacts(request->parent(), request->name_prefix(), *first, PageSize(request->page_size(), kMaxPage));
  if (!page.ok()) return ToGrpc(page.status());
  AddFiles(page->artifacts, response->mutable_artifacts());
  if (page->next >= 0) response->set_next_page_token(std::to_string(page->next));
  return grpc::Status::OK;
}

grpc::Status JobsService::ListSettings(grpc::ServerContext*, const v1::ListSettingsRequest*,
                                       v1::ListSettingsResponse* response) {
  for (const ListedSetting& setting : ListedSettings()) ToProto(setting, response->add_settings());
  for (size_t i = 0; i < kMethods.size(); ++i) {
    v1::NamedChoice& method = *response->add_methods();
    method.set_name(kMethods[i]);
    method.set_help(kMethodHelps[i]);
  }
  for (const ExportFormat& each : ExportFormats()) {
    v1::NamedChoice& format = *response->add_formats();
    format.set_name(std::string(each.name));
    format.set_help(std::string(each.what));
  }
  return grpc::Status::OK;
}

grpc::Status JobsService::QuoteJob(grpc::ServerContext* context, const v1::CreateJobRequest* request,
                                   v1::Quote* response) {
  const Submission submission = SubmissionOf(*request, environment_.access->CallerOf(*context));
  const auto quote = admission_.Quote(submission, [&] { return context->IsCancelled() || core_.stopped(); });
  if (!quote.ok()) return ToGrpc(quote.status());
  ToProto(*quote, response);
  return grpc::Status::OK;
}

}  // namespace tessera
