"""A small window out of which one file can be dragged: `python3 drag_source.py FILE X Y`. Needs Tk and tkdnd.

It uses XDND like a file manager, is at (X, Y) px above all other windows, and closes when its file was dropped.
"""

import sys
import tkinter


def main(path: str, x: str, y: str) -> None:
    root = tkinter.Tk()
    root.overrideredirect(True)
    root.geometry(f"160x60+{x}+{y}")
    root.tk.call("package", "require", "tkdnd")
    label = tkinter.Label(root, text=path.rpartition("/")[2], bg="#e8e8e8", fg="black")
    label.pack(fill="both", expand=True)
    root.tk.call("tkdnd::drag_source", "register", label, "DND_Files")
    dragged = root.register(lambda: ("copy", "DND_Files", (path,)))
    root.tk.call("bind", label, "<<DragInitCmd>>", dragged)
    root.tk.call("bind", label, "<<DragEndCmd>>", root.register(lambda *_: root.after(200, root.destroy)))
    root.mainloop()


if __name__ == "__main__":
    main(*sys.argv[1:])
