// A page that is read as a file cannot load the index that the search looks through.
if (location.protocol === "file:") {
  for (const input of document.querySelectorAll(".md-search__input")) {
    input.placeholder = "The search needs a server: python3 -m http.server, in this folder";
    input.title = input.placeholder;
    input.disabled = true;
  }
}
